//! The kinematic projection: drives a vehicle along planned poses without ever leaving the limits of the benchmark.
//!
//! Plans of networks are made of tokens, each of which starts at another speed than the last one ended with; judged by position
//! differences, such seams are impossible accelerations. The tracker follows the planned poses as a vehicle could: the rear axle moves
//! along the heading (kinematic bicycle model), acceleration, jerk and curvature are bounded, and the speed that it states is the way of
//! the box centre over 0.1 s, exactly. The bounds are below those of the metrics, in the metrics' own terms.
//!
//! At every step two constants are fitted to the next planned poses, by least squares: the acceleration and its change in time, and the
//! curvature and its change along the way. What is fitted are positions and speeds, and positions and headings; the fit is then cut to
//! what the vehicle can do. Beyond its end a plan is thought to go on as it ended.

mod aim;
mod fit;

use self::aim::{Aim, aim};
use self::fit::{Bend, gains};
use super::Pose;
use crate::geometry::{Vec2, direction, left, math, wrap};
use crate::scene::{AgentState, DT, Frame};

/// Planned poses that are looked at ahead of each step.
const PREVIEW: usize = 5;
/// Deceleration at which a vehicle that was behind its plan comes back to the plan's speed, m/s².
const CATCHING_UP: f64 = 2.5;
/// A plan that is slower stands, m/s.
const STANDING: f64 = 0.02;
/// Largest angle between the heading and a planned heading that the fit takes, radians.
const LARGEST_ANGLE: f64 = 0.8;
/// Largest sine of the angle between the way of the box centre and the heading.
const LARGEST_SLIP: f64 = 0.6;

/// What a vehicle is able to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ability {
    /// Largest magnitude of the acceleration, m/s². The metric's bound is [`super::MAX_ACCELERATION`].
    pub acceleration: f64,
    /// Largest magnitude of the curvature by the metric's formula, 1/m. The metric's bound is [`super::MAX_CURVATURE`].
    pub curvature: f64,
    /// Largest change of the acceleration, m/s³. A vehicle that comes to a halt is no longer braked at once.
    pub jerk: f64,
    /// How far the rear axle lies behind the box centre, metres: [`super::REAR_AXLE`] times the length for poses like those of
    /// logs; 0 for poses whose centre moves along the heading.
    pub rear: f64,
}

impl Ability {
    /// A vehicle with its rear axle so many metres behind the centre; the bounds leave a margin of a tenth to the metrics'.
    pub fn of_vehicle(rear: f64) -> Self {
        Self { acceleration: 5.5, curvature: 0.27, jerk: 30.0, rear }
    }
}

/// How a vehicle moves at one instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Moving {
    /// Box centre and heading.
    pub pose: Pose,
    /// Way of the centre in the last step over 0.1 s, m/s; negative backwards.
    pub speed: f64,
    /// Change of that speed in the last step over 0.1 s, m/s².
    pub acceleration: f64,
}

impl Moving {
    /// How a vehicle moves after these states, the last of which is now; `None` where it is absent now.
    ///
    /// The speed is that of the velocity that the states have, as in the metrics; where it is unknown the positions tell it, and where
    /// those do not, the vehicle stands.
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

    /// After a step of 0.1 s at `speed` (way of the centre over 0.1 s, m/s, negative backwards) in which the heading turns by `turn`
    /// (radians) about a rear axle that lies `rear` metres behind the centre.
    pub fn moved(&self, speed: f64, turn: f64, rear: f64) -> Self {
        let acceleration = (speed - self.speed) / DT;
        if speed == 0.0 {
            return Self { speed, acceleration, ..*self };
        }
        // The centre goes aside of the heading as far as it swings about the rear axle.
        let aside = 2.0 * rear * math::sin(0.5 * turn);
        let way = speed.abs() * DT;
        let along = (way * way - aside * aside).max(0.0).sqrt().copysign(speed);
        let facing = direction(self.pose.heading + 0.5 * turn);
        let position = self.pose.position + facing * along + left(facing) * aside;
        Self { pose: Pose { position, heading: wrap(self.pose.heading + turn) }, speed, acceleration }
    }

    /// The state with the velocity that the last step had, for a step that started at `from`.
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

/// Follows planned poses within what a vehicle is able to do.
#[derive(Clone, Debug)]
pub struct Tracker {
    ability: Ability,
    /// What positions and speeds ahead weigh in the acceleration of the next step, 1/s² and 1/s.
    gains: [(f64, f64); PREVIEW],
    /// How long a way takes that is made up for without haste, seconds.
    lag: f64,
    aims: Vec<Aim>,
}

impl Tracker {
    /// A tracker for vehicles of one ability.
    pub fn new(ability: Ability) -> Self {
        let gains = gains();
        let (mut place, mut pace) = (0.0, 0.0);
        for (j, (p, q)) in gains.iter().enumerate() {
            place += p;
            pace += p * DT * (j + 1) as f64 + q;
        }
        Self { ability, gains, lag: pace / place, aims: Vec::new() }
    }

    /// Puts a vehicle of another ability in the place of the last one.
    pub fn set_ability(&mut self, ability: Ability) {
        self.ability = ability;
    }

    /// Drives from `now` along the planned `poses`, 0.1 s apart, the first of which is due after 0.1 s. Replaces the content of `driven`
    /// by one instant for each pose. Poses must be finite.
    pub fn track(&mut self, now: Moving, poses: &[Pose], driven: &mut Vec<Moving>) {
        driven.clear();
        aim(&self.ability, now.pose, poses, &mut self.aims);
        let limit = self.ability.acceleration;
        let mut moving = Moving { acceleration: now.acceleration.clamp(-limit, limit), ..now };
        for k in 0..poses.len() {
            moving = self.step(moving, k);
            driven.push(moving);
        }
    }

    /// The next instant, `k` steps after the plan's beginning.
    fn step(&self, now: Moving, k: usize) -> Moving {
        let aims = &self.aims[k..k + PREVIEW];
        let net: f64 = aims.iter().map(|a| a.speed).sum::<f64>() / PREVIEW as f64;
        let stands = aims.iter().all(|a| a.speed.abs() < STANDING);
        // +1 ahead, -1 backwards; a vehicle whose plan stands rolls out the way it goes.
        let sign = if stands { now.speed } else { net };
        let sign = if sign < 0.0 { -1.0 } else { 1.0 };
        let gap = sign * (aims[0].centre - now.pose.position).dot(&aims[0].ahead);
        let speed = sign * now.speed;
        if speed == 0.0 {
            let ahead = gap + aims[1..].iter().map(|a| sign * a.speed * DT).sum::<f64>();
            if ahead < STANDING * DT * PREVIEW as f64 {
                return Moving { speed: 0.0, acceleration: 0.0, ..now };
            }
        }
        let next = self.next_speed(speed, sign * now.acceleration, sign, gap, aims, stands);
        let acceleration = sign * (next - speed) / DT;
        if next == 0.0 {
            return Moving { speed: 0.0, acceleration, ..now };
        }
        let turn = if next > 0.0 { self.turn(now.pose, speed, next, sign, k) } else { 0.0 };
        Moving { acceleration, ..now.moved(sign * next, turn, self.ability.rear) }
    }

    /// The speed of the next step, towards the plan's side.
    fn next_speed(&self, speed: f64, last: f64, sign: f64, gap: f64, aims: &[Aim], stands: bool) -> f64 {
        let mut wanted = 0.0;
        // How far it is behind the plan now; a long way is made up for no faster than what is then too much speed can be braked away.
        let due = sign * aims[0].speed * DT;
        let behind = gap - due;
        let most = self.lag * (2.0 * CATCHING_UP * behind.abs()).sqrt();
        let mut ahead = due + behind.clamp(-most, most);
        for (j, (aim, (place, pace))) in aims.iter().zip(self.gains).enumerate() {
            if j > 0 {
                ahead += sign * aim.speed * DT;
            }
            wanted += place * (ahead - speed * DT * (j + 1) as f64) + pace * (sign * aim.speed - speed);
        }
        let Ability { acceleration: limit, jerk, .. } = self.ability;
        let least = (last - jerk * DT).max(-limit);
        let most = (last + jerk * DT).min(limit);
        let mut next = speed + wanted.clamp(least, most) * DT;
        if speed >= 0.0 {
            next = next.max(0.0);
        }
        // Where a plan stands, standing is exact.
        if stands && speed.abs() <= limit * DT && gap < 0.02 {
            next = 0.0;
        }
        next
    }

    /// The turn of the next step, radians, which goes from `speed` to `next` (both towards the plan's side, `next` > 0).
    fn turn(&self, now: Pose, speed: f64, next: f64, sign: f64, k: usize) -> f64 {
        let rear = self.ability.rear;
        let facing = direction(now.heading);
        let axle = now.position - facing * rear;
        let mut bend = Bend::new();
        let (mut way, mut before, mut taken) = (0.0, axle, 0);
        for aim in &self.aims[k..k + PREVIEW] {
            let to = (aim.axle - axle) * sign;
            let along = to.dot(&facing);
            let angle = wrap(aim.heading - now.heading);
            if along <= 0.25 * next * DT {
                continue;
            }
            if taken > 0 && angle.abs() > LARGEST_ANGLE {
                break;
            }
            way += (aim.axle - before).norm();
            before = aim.axle;
            bend.take(way, facing.perp(&to), angle.clamp(-LARGEST_ANGLE, LARGEST_ANGLE));
            taken += 1;
        }
        if taken == 0 {
            // Beyond the plan's end: along the line on which it ended.
            let end = &self.aims[self.aims.len() - 1];
            let line = direction(end.heading) * sign;
            let reach = (0.4 * next).max(2.0);
            let along = (axle - end.axle).dot(&line).max(0.0);
            let to = (end.axle + line * (along + reach) - axle) * sign;
            let angle = wrap(end.heading - now.heading).clamp(-LARGEST_ANGLE, LARGEST_ANGLE);
            bend.take(reach, facing.perp(&to), angle);
        }
        let way = next * DT;
        let curvature = bend.curvature(0.5 * way);
        let slip = rear * curvature;
        let turn = curvature * way / (1.0 + slip * slip).sqrt();
        let mut most = self.ability.curvature * DT * next.min(0.5 * (speed.max(0.0) + next));
        if rear.abs() > 0.0 {
            most = most.min(LARGEST_SLIP * way / rear.abs());
        }
        turn.clamp(-most, most)
    }
}

#[cfg(test)]
#[path = "tracker/tests.rs"]
mod tests;
