//! The kinematic projection: follows planned poses without ever exceeding the limits of the
//! benchmark.
//!
//! Network plans are made of tokens, and each token starts at a different speed from the one at
//! which the previous token ended. Judged by position differences, such seams are impossible
//! accelerations. The tracker follows the planned poses as a vehicle could: the rear axle moves
//! along the heading (kinematic bicycle model); acceleration, jerk and curvature are bounded; and
//! the stated speed is exactly the distance travelled by the box centre divided by 0.1 s. The
//! bounds are below those of the metrics, in the metrics' own terms.
//!
//! At every step two linear functions are fitted to the next planned poses by least squares: the
//! acceleration over time, fitted to positions and speeds, and the curvature along the path, fitted
//! to positions and headings. The fit is then clamped to the vehicle's limits. Beyond its end a
//! plan is extrapolated with its final motion.

mod aim;
mod fit;

use reactsim_geometry::{Vec2, direction, left, math, wrap};

use self::aim::{Aim, aim};
use self::fit::{Bend, gains};
use super::Pose;
use crate::{AgentState, DT, Frame};

/// Number of planned poses considered ahead of each step.
const PREVIEW_POSES: usize = 5;
/// Deceleration at which a vehicle that has caught up with its plan returns to the plan's speed,
/// m/s².
const CATCH_UP_DECELERATION: f64 = 2.5;
/// Speed below which a plan counts as stationary, m/s.
const STANDSTILL_SPEED: f64 = 0.02;
/// Largest difference between the heading and a planned heading that the fit accepts, radians.
const MAX_HEADING_DIFFERENCE: f64 = 0.8;
/// Largest sine of the angle between the motion of the box centre and the heading.
const MAX_SLIP_SINE: f64 = 0.6;

/// Kinematic limits of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLimits {
    /// Largest magnitude of the acceleration, m/s². The metric's bound is [`super::MAX_ACCELERATION`].
    pub acceleration: f64,
    /// Largest magnitude of the curvature by the metric's formula, 1/m. The metric's bound is
    /// [`super::MAX_CURVATURE`].
    pub curvature: f64,
    /// Largest change of the acceleration, m/s³. It does not apply when a vehicle comes to a halt:
    /// braking then ends at once.
    pub jerk: f64,
    /// Distance from the box centre back to the rear axle, metres: [`super::REAR_AXLE`] times the
    /// length for poses like those of logs; 0 for poses whose centre moves along the heading.
    pub rear: f64,
}

impl MotionLimits {
    /// Returns the limits of a vehicle whose rear axle is `rear` metres behind its centre; they
    /// leave a margin of a tenth to the bounds of the metrics.
    pub fn of_vehicle(rear: f64) -> Self {
        Self { acceleration: 5.5, curvature: 0.27, jerk: 30.0, rear }
    }
}

/// Motion of a vehicle at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VehicleMotion {
    /// Box centre and heading.
    pub pose: Pose,
    /// Distance travelled by the centre in the last step divided by 0.1 s, m/s; negative backwards.
    pub speed: f64,
    /// Change of that speed in the last step over 0.1 s, m/s².
    pub acceleration: f64,
}

impl VehicleMotion {
    /// Returns the motion of a vehicle after these states, the last of which is the current one;
    /// `None` if it is absent in that one.
    ///
    /// The speed comes from the velocities of the states, as in the metrics; where they are
    /// unknown, from position differences; failing that, the vehicle is at rest.
    pub fn after(states: &[Frame]) -> Option<Self> {
        let at = |back: usize| states.len().checked_sub(back + 1).and_then(|i| states[i]);
        let signed = |back: usize| {
            let now = at(back)?;
            let velocity = match now.velocity() {
                Some(v) => v,
                None => (now.position() - at(back + 1)?.position()) / DT,
            };
            let ahead = velocity.dot(&direction(now.heading));
            Some(if ahead < 0.0 { -velocity.norm() } else { velocity.norm() })
        };
        let now = at(0)?;
        let speed = signed(0).unwrap_or(0.0);
        let acceleration = signed(1).map_or(0.0, |before| (speed - before) / DT);
        Some(Self { pose: Pose::from(now), speed, acceleration })
    }

    /// Returns the motion after one more step at `speed` (distance travelled by the centre over 0.1
    /// s, m/s, negative backwards) in which the heading turns by `turn` (radians) about a rear axle
    /// `rear` metres behind the centre.
    pub fn moved(&self, speed: f64, turn: f64, rear: f64) -> Self {
        let acceleration = (speed - self.speed) / DT;
        if speed == 0.0 {
            return Self { speed, acceleration, ..*self };
        }
        // Lateral displacement of the centre: its swing about the rear axle.
        let aside = 2.0 * rear * math::sin(0.5 * turn);
        let distance = speed.abs() * DT;
        let along = (distance * distance - aside * aside).max(0.0).sqrt().copysign(speed);
        let facing = direction(self.pose.heading + 0.5 * turn);
        let position = self.pose.position + facing * along + left(facing) * aside;
        Self { pose: Pose { position, heading: wrap(self.pose.heading + turn) }, speed, acceleration }
    }

    /// Returns the state, with the velocity of the last step, which started at `from`.
    pub fn state(&self, from: Vec2) -> AgentState {
        let v = (self.pose.position - from) / DT;
        AgentState {
            x: self.pose.position.x,
            y: self.pose.position.y,
            heading: self.pose.heading,
            vx: v.x,
            vy: v.y,
        }
    }
}

/// Controller that follows planned poses within a vehicle's limits.
#[derive(Clone, Debug)]
pub struct Tracker {
    limits: MotionLimits,
    /// Weights of position and speed errors of the next poses in the acceleration of the next step,
    /// 1/s² and 1/s.
    gains: [(f64, f64); PREVIEW_POSES],
    /// Time scale on which a position error is made up without haste, seconds.
    lag: f64,
    aims: Vec<Aim>,
}

impl Tracker {
    /// Creates a tracker for vehicles with these limits.
    pub fn new(limits: MotionLimits) -> Self {
        let gains = gains();
        let (mut place, mut pace) = (0.0, 0.0);
        for (j, (p, q)) in gains.iter().enumerate() {
            place += p;
            pace += p * DT * (j + 1) as f64 + q;
        }
        Self { limits, gains, lag: pace / place, aims: Vec::new() }
    }

    /// Replaces the limits, for another vehicle.
    pub fn set_limits(&mut self, limits: MotionLimits) {
        self.limits = limits;
    }

    /// Drives from `now` along the planned `poses`, 0.1 s apart, the first of which is due after
    /// 0.1 s. Replaces the content of `driven` by one motion state per pose. Poses must be finite.
    pub fn track(&mut self, now: VehicleMotion, poses: &[Pose], driven: &mut Vec<VehicleMotion>) {
        driven.clear();
        aim(&self.limits, now.pose, poses, &mut self.aims);
        let limit = self.limits.acceleration;
        let mut moving = VehicleMotion { acceleration: now.acceleration.clamp(-limit, limit), ..now };
        for k in 0..poses.len() {
            moving = self.step(moving, k);
            driven.push(moving);
        }
    }

    /// Returns the next motion state, `k` steps after the start of the plan.
    fn step(&self, now: VehicleMotion, k: usize) -> VehicleMotion {
        let aims = &self.aims[k..k + PREVIEW_POSES];
        let net: f64 = aims.iter().map(|a| a.speed).sum::<f64>() / PREVIEW_POSES as f64;
        let stationary = aims.iter().all(|a| a.speed.abs() < STANDSTILL_SPEED);
        // +1 forwards, -1 backwards; a vehicle whose plan is stationary keeps its direction until
        // it halts.
        let sign = if stationary { now.speed } else { net };
        let sign = if sign < 0.0 { -1.0 } else { 1.0 };
        let gap = sign * (aims[0].centre - now.pose.position).dot(&aims[0].ahead);
        let speed = sign * now.speed;
        if speed == 0.0 {
            let ahead = gap + aims[1..].iter().map(|a| sign * a.speed * DT).sum::<f64>();
            if ahead < STANDSTILL_SPEED * DT * PREVIEW_POSES as f64 {
                return VehicleMotion { speed: 0.0, acceleration: 0.0, ..now };
            }
        }
        let next = self.next_speed(speed, sign * now.acceleration, sign, gap, aims, stationary);
        let acceleration = sign * (next - speed) / DT;
        if next == 0.0 {
            return VehicleMotion { speed: 0.0, acceleration, ..now };
        }
        let turn = if next > 0.0 { self.turn(now.pose, speed, next, sign, k) } else { 0.0 };
        VehicleMotion { acceleration, ..now.moved(sign * next, turn, self.limits.rear) }
    }

    /// Returns the speed of the next step, positive in the direction of the plan.
    fn next_speed(&self, speed: f64, last: f64, sign: f64, gap: f64, aims: &[Aim], stationary: bool) -> f64 {
        let mut wanted = 0.0;
        // Distance by which the vehicle is behind its plan, limited so that the extra speed to make
        // it up can be braked away again.
        let due = sign * aims[0].speed * DT;
        let behind = gap - due;
        let most = self.lag * (2.0 * CATCH_UP_DECELERATION * behind.abs()).sqrt();
        let mut ahead = due + behind.clamp(-most, most);
        for (j, (aim, (place, pace))) in aims.iter().zip(self.gains).enumerate() {
            if j > 0 {
                ahead += sign * aim.speed * DT;
            }
            wanted += place * (ahead - speed * DT * (j + 1) as f64) + pace * (sign * aim.speed - speed);
        }
        let MotionLimits { acceleration: limit, jerk, .. } = self.limits;
        let least = (last - jerk * DT).max(-limit);
        let most = (last + jerk * DT).min(limit);
        let mut next = speed + wanted.clamp(least, most) * DT;
        if speed >= 0.0 {
            next = next.max(0.0);
        }
        // If the plan is stationary, the vehicle stops exactly.
        if stationary && speed.abs() <= limit * DT && gap < 0.02 {
            next = 0.0;
        }
        next
    }

    /// Returns the heading change of the next step, radians, in which the speed goes from `speed`
    /// to `next` (both positive in the direction of the plan, `next` > 0).
    fn turn(&self, now: Pose, speed: f64, next: f64, sign: f64, k: usize) -> f64 {
        let rear = self.limits.rear;
        let facing = direction(now.heading);
        let axle = now.position - facing * rear;
        let mut bend = Bend::new();
        let (mut arc, mut before, mut taken) = (0.0, axle, 0);
        for aim in &self.aims[k..k + PREVIEW_POSES] {
            let to = (aim.axle - axle) * sign;
            let along = to.dot(&facing);
            let angle = wrap(aim.heading - now.heading);
            if along <= 0.25 * next * DT {
                continue;
            }
            if taken > 0 && angle.abs() > MAX_HEADING_DIFFERENCE {
                break;
            }
            arc += (aim.axle - before).norm();
            before = aim.axle;
            bend.take(arc, facing.perp(&to), angle.clamp(-MAX_HEADING_DIFFERENCE, MAX_HEADING_DIFFERENCE));
            taken += 1;
        }
        if taken == 0 {
            // Beyond the end of the plan: along the line on which it ended.
            let end = &self.aims[self.aims.len() - 1];
            let line = direction(end.heading) * sign;
            let reach = (0.4 * next).max(2.0);
            let along = (axle - end.axle).dot(&line).max(0.0);
            let to = (end.axle + line * (along + reach) - axle) * sign;
            let angle =
                wrap(end.heading - now.heading).clamp(-MAX_HEADING_DIFFERENCE, MAX_HEADING_DIFFERENCE);
            bend.take(reach, facing.perp(&to), angle);
        }
        let distance = next * DT;
        let curvature = bend.curvature(0.5 * distance);
        let slip = rear * curvature;
        let turn = curvature * distance / (1.0 + slip * slip).sqrt();
        let mut most = self.limits.curvature * DT * next.min(0.5 * (speed.max(0.0) + next));
        if rear.abs() > 0.0 {
            most = most.min(MAX_SLIP_SINE * distance / rear.abs());
        }
        turn.clamp(-most, most)
    }
}

#[cfg(test)]
mod tests;
