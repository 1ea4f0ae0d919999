//! The kinematic bicycle model along a guide line: paths of vehicles with front-wheel steering,
//! whose rear axle follows the guide, and the speeds at which these paths can be driven.

use std::f64::consts::PI;

use reactsim_geometry::{Polyline, Vec2, direction, wrap};

use super::{Pose, speeds};
use crate::{AgentState, DT};

/// Spacing of the poses of a path, in metres of rear-axle travel.
const POSE_SPACING: f64 = 0.1;
/// Largest curvature of the rear-axle path, 1/m: about that of a car at full steering lock.
const MAX_AXLE_CURVATURE: f64 = 0.26;
/// Largest rate of change of the rear-axle curvature along the path, 1/m².
const MAX_AXLE_CURVATURE_RATE: f64 = 0.15;
/// Largest lateral acceleration, m/s²; below the 4 m/s² that scripted AVs stay under.
const MAX_LATERAL_ACCELERATION: f64 = 3.8;
/// Deceleration ahead of a curve, m/s².
const CURVE_DECELERATION: f64 = 4.0;
/// Largest curvature of a step by the metric's formula, 1/m; the metric's bound is 0.3.
const MAX_STEP_CURVATURE: f64 = 0.295;
/// Speed below which the metric computes no curvature, m/s.
const MIN_CURVATURE_SPEED: f64 = 0.6;
/// Distance from the box centre back to the rear axle, as a share of the vehicle length (nuPlan's
/// vehicle: 1.461 m of 5.176 m).
pub const REAR_AXLE: f64 = 0.28;

/// A path as poses of the box centre, 0.1 m apart along the path of the rear axle.
///
/// The rear axle is the reference point because it moves in the direction of the vehicle's heading;
/// the box centre swings out in curves, as it does in logs.
#[derive(Clone, Debug)]
pub struct AxlePath {
    centers: Vec<Vec2>,
    headings: Vec<f64>,
    /// Arc length of the centre path up to each pose, metres.
    arc: Vec<f64>,
    /// Curvature of the centre path from each pose to the next, 1/m.
    curvatures: Vec<f64>,
    /// Arc length at which the vehicle must have stopped, if any, metres.
    end: Option<f64>,
    /// Largest lateral acceleration, m/s².
    lateral: f64,
    /// Speed limit at each pose, m/s; empty if there is none.
    limits: Vec<f64>,
}

/// Initial state of a vehicle at the start of an [`AxlePath`].
#[derive(Clone, Copy, Debug)]
pub struct Departure {
    /// Box centre and heading.
    pub pose: Pose,
    /// Distance from the box centre back to the rear axle, metres.
    pub rear: f64,
    /// Whether the vehicle drives backwards.
    pub reverse: bool,
    /// Curvature of the rear-axle path, 1/m; `None` starts with the curvature that pure pursuit of
    /// the guide gives.
    pub curvature: Option<f64>,
    /// Largest rate of change of that curvature, 1/m per second.
    pub steering_speed: f64,
}

/// Rate of curvature change for calm steering, 1/m per second: about 40 degrees per second at the
/// road wheels of a car.
pub const CALM_STEERING_RATE: f64 = 0.25;

impl AxlePath {
    /// Drives the rear axle along `guide` from the exact pose of `from`, for `reach` metres of
    /// rear-axle travel.
    ///
    /// The controller is pure pursuit (Coulter, 1992) with bounded curvature. Its look-ahead
    /// distance grows with `pace`, the expected speed (m/s) as a function of the distance driven
    /// (metres), so that recording noise does not become lateral acceleration.
    pub fn trace(guide: &Polyline, from: &Departure, reach: f64, pace: impl Fn(f64) -> f64) -> Self {
        let flip = if from.reverse { PI } else { 0.0 };
        let Pose { position, heading } = from.pose;
        let mut course = heading + flip;
        let mut axle = position - direction(heading) * from.rear;
        let count = (reach / POSE_SPACING) as usize + 2;
        let mut path = Self {
            centers: vec![position],
            headings: vec![heading],
            arc: vec![0.0],
            curvatures: Vec::with_capacity(count),
            end: None,
            lateral: MAX_LATERAL_ACCELERATION,
            limits: Vec::new(),
        };
        let (mut curvature, mut segment) = (from.curvature, 0);
        for _ in 0..count {
            let nearest = guide.project_between(axle, segment, segment + 12);
            segment = nearest.segment;
            // The projection is clamped to the last segment; the guide is extended straight beyond
            // it.
            let s = nearest.s + if nearest.t >= 1.0 { past_end(guide, axle) } else { 0.0 };
            let driven = path.arc[path.arc.len() - 1];
            let pace = pace(driven);
            let target = guide.at(s + (0.5 * pace).clamp(2.2, 10.0)) - axle;
            let bend = 2.0 * direction(course).perp(&target) / target.norm_squared().max(1.0);
            let change = MAX_AXLE_CURVATURE_RATE.min(from.steering_speed / pace.max(0.1)) * POSE_SPACING;
            let bend = curvature
                .map_or(bend, |c| bend.clamp(c - change, c + change))
                .clamp(-MAX_AXLE_CURVATURE, MAX_AXLE_CURVATURE);
            curvature = Some(bend);
            axle += direction(course + 0.5 * bend * POSE_SPACING) * POSE_SPACING;
            course += bend * POSE_SPACING;
            let heading = course - flip;
            let center = axle + direction(heading) * from.rear;
            let step = (center - path.centers[path.centers.len() - 1]).norm();
            let turn = wrap(heading - path.headings[path.headings.len() - 1]).abs();
            path.curvatures.push(turn / step.max(0.5 * POSE_SPACING));
            path.arc.push(path.arc[path.arc.len() - 1] + step.max(1e-9));
            path.centers.push(center);
            path.headings.push(wrap(heading));
        }
        path
    }

    /// Returns the number of poses.
    #[inline]
    pub fn poses(&self) -> usize {
        self.centers.len()
    }

    /// Returns the pose after `index` × 0.1 m of rear-axle travel, and its arc length on the centre
    /// path, metres.
    #[inline]
    pub fn pose(&self, index: usize) -> (Pose, f64) {
        (Pose { position: self.centers[index], heading: self.headings[index] }, self.arc[index])
    }

    /// Returns the path of the box centre as a polyline with a point every half metre of rear-axle
    /// travel.
    pub fn centre_line(&self) -> Polyline {
        let points: Vec<Vec2> = self.centers.iter().step_by(5).copied().collect();
        let ahead = self.centers[0] + direction(self.headings[0]);
        Polyline::new(&points)
            .unwrap_or_else(|_| Polyline::new(&[self.centers[0], ahead]).expect("two points a metre apart"))
    }

    /// Returns the index of the pose that the rear axle reaches after `distance` metres of its own
    /// travel.
    pub fn index_of_axle(&self, distance: f64) -> usize {
        ((distance / POSE_SPACING) as usize).min(self.arc.len() - 1)
    }

    /// Sets the largest lateral acceleration, m/s² (default 3.8).
    pub fn limit_lateral(&mut self, acceleration: f64) {
        self.lateral = acceleration;
    }

    /// Sets the speed limit, m/s, as a function of the arc length on the centre path, metres.
    pub fn limit_speed(&mut self, limit: impl Fn(f64) -> f64) {
        self.limits = self.arc.iter().map(|&s| limit(s)).collect();
    }

    /// Ends the path with a halt after `s` metres.
    pub fn stop_at(&mut self, s: f64) {
        self.end = Some(s);
    }

    /// Returns the index of the pose at or before arc length `s`, and the fraction of the interval
    /// after it.
    fn locate(&self, s: f64) -> (usize, f64) {
        let i = self.arc.partition_point(|&a| a <= s).clamp(1, self.arc.len() - 1) - 1;
        (i, (s - self.arc[i]) / (self.arc[i + 1] - self.arc[i]))
    }

    /// Like [`Self::locate`], but walks from the pose `near`: faster for an `s` close to it.
    fn locate_from(&self, s: f64, near: usize) -> (usize, f64) {
        let last = self.arc.len() - 2;
        let mut i = near.min(last);
        while i < last && self.arc[i + 1] <= s {
            i += 1;
        }
        while i > 0 && s < self.arc[i] {
            i -= 1;
        }
        (i, (s - self.arc[i]) / (self.arc[i + 1] - self.arc[i]))
    }

    fn between(&self, (i, t): (usize, f64)) -> Vec2 {
        self.centers[i] + (self.centers[i + 1] - self.centers[i]) * t
    }

    /// Returns the position of the box centre after `s` metres.
    #[inline]
    pub fn position(&self, s: f64) -> Vec2 {
        self.between(self.locate(s))
    }

    /// Returns the heading after `s` metres, radians.
    #[inline]
    pub fn heading(&self, s: f64) -> f64 {
        let (i, t) = self.locate(s);
        wrap(self.headings[i] + wrap(self.headings[i + 1] - self.headings[i]) * t)
    }

    /// Returns the arc length at which the centre is `distance` metres of straight line away from
    /// `from`, its position at `s`.
    pub fn advance(&self, s: f64, from: Vec2, distance: f64) -> f64 {
        if distance == 0.0 {
            return s;
        }
        let (mut low, mut high) = (s, s + 1.5 * distance);
        let mut near = self.locate(s).0;
        for _ in 0..40 {
            let middle = 0.5 * (low + high);
            let place = self.locate_from(middle, near);
            near = place.0;
            if (self.between(place) - from).norm() < distance { low = middle } else { high = middle }
        }
        high
    }

    /// Returns the speed that curves, speed limits, and the end of the path (if any) allow at each
    /// pose, with braking for those ahead.
    pub fn allowed_speeds(&self) -> Allowed<'_> {
        let mut speeds: Vec<f64> = Vec::with_capacity(self.arc.len());
        for (i, &s) in self.arc.iter().enumerate() {
            let curvature = self.curvatures[i.min(self.curvatures.len() - 1)];
            let ended = self.end.is_some_and(|end| s >= end);
            let limit = self.limits.get(i).copied().unwrap_or(f64::INFINITY);
            speeds.push(if ended { 0.0 } else { (self.lateral / curvature.max(1e-6)).sqrt().min(limit) });
        }
        for i in (0..speeds.len() - 1).rev() {
            let step = self.arc[i + 1] - self.arc[i];
            speeds[i] =
                speeds[i].min((speeds[i + 1] * speeds[i + 1] + 2.0 * CURVE_DECELERATION * step).sqrt());
        }
        Allowed { path: self, speeds }
    }
}

/// Largest allowed speed along a path.
pub struct Allowed<'a> {
    path: &'a AxlePath,
    speeds: Vec<f64>,
}

impl Allowed<'_> {
    /// Returns the allowed speed after `s` metres, m/s.
    #[inline]
    pub fn at(&self, s: f64) -> f64 {
        let (i, t) = self.path.locate(s);
        self.speeds[i] + (self.speeds[i + 1] - self.speeds[i]) * t.min(1.0)
    }
}

/// Drives along a path from the state `now` and returns one state per step.
///
/// `speed_now` is the current speed (m/s) in the direction of the path. The `desired` speeds are
/// met as far as the path and the limits of the metrics allow. A vehicle at rest keeps its state
/// exactly.
pub fn follow(now: AgentState, speed_now: f64, path: &AxlePath, desired: &[f64]) -> Vec<AgentState> {
    drive(now, speed_now, path, desired, Some(&path.allowed_speeds()))
}

/// Like [`follow`], but smooths changes of the acceleration ([`speeds::soften_from`]), given the
/// current `acceleration` (m/s²).
///
/// In curves and at the end of the path the speeds are close to those of [`follow`].
pub fn follow_smoothly(
    now: AgentState,
    speed_now: f64,
    acceleration: f64,
    path: &AxlePath,
    desired: &[f64],
) -> Vec<AgentState> {
    let sharp = follow(now, speed_now, path, desired);
    let mut smooth: Vec<f64> = sharp.iter().map(AgentState::speed).collect();
    speeds::soften_from(speed_now, acceleration, &mut smooth);
    drive(now, speed_now, path, &smooth, None)
}

/// Drives along a path at the `desired` speeds, or at the `allowed` ones where these are lower.
fn drive(
    now: AgentState,
    speed_now: f64,
    path: &AxlePath,
    desired: &[f64],
    allowed: Option<&Allowed<'_>>,
) -> Vec<AgentState> {
    let (mut s, mut speed, mut state) = (0.0, speed_now, now);
    // Change of speed in the last step, and whether a curve holds the speed below the desired one.
    let (mut change, mut held) = (0.0, false);
    let mut track = Vec::with_capacity(desired.len());
    for &wanted in desired {
        // Looking ahead gives the deceleration time to build up.
        let ceiling = allowed.map_or(f64::INFINITY, |allowed| {
            allowed.at(s + 0.5 * (speed + wanted) * DT).min(allowed.at(s + 4.0 * speed * DT))
        });
        held = ceiling < wanted || (held && speed < wanted - speeds::SPEED_GAIN_STEP);
        let aim = if held {
            let least = (change - 2.0 * speeds::SPEED_GAIN_STEP).max(-speeds::MAX_CURVE_SPEED_LOSS);
            let most = (change + speeds::SPEED_GAIN_STEP).clamp(least, speeds::MAX_CURVE_SPEED_GAIN);
            speed + (wanted.min(ceiling) - speed).clamp(least, most)
        } else {
            wanted
        };
        let mut next =
            aim.clamp((speed - speeds::MAX_SPEED_CHANGE).max(0.0), speed + speeds::MAX_SPEED_CHANGE);
        if held {
            next = speeds::halted(next);
        }
        let mut reached = path.advance(s, state.position(), next * DT);
        // When speeding up, the heading changes more in a step than the mean speed implies: speed
        // up less.
        for _ in 0..8 {
            let turn = wrap(path.heading(reached) - state.heading).abs();
            let judged = speed >= MIN_CURVATURE_SPEED && next >= MIN_CURVATURE_SPEED;
            if next <= speed || !judged || turn <= MAX_STEP_CURVATURE * 0.5 * (speed + next) * DT {
                break;
            }
            next = 0.5 * (speed + next);
            reached = path.advance(s, state.position(), next * DT);
        }
        if next == 0.0 {
            state = AgentState { vx: 0.0, vy: 0.0, ..state };
        } else {
            let p = path.position(reached);
            let v = (p - state.position()) / DT;
            state = AgentState { x: p.x, y: p.y, heading: path.heading(reached), vx: v.x, vy: v.y };
        }
        (change, s, speed) = (next - speed, reached, next);
        track.push(state);
    }
    track
}

/// Returns how far `p` is beyond the end of a polyline, along its last segment, metres.
fn past_end(line: &Polyline, p: Vec2) -> f64 {
    let end = line.points()[line.segments()];
    (p - end).dot(&direction(line.heading(line.segments() - 1))).max(0.0)
}
