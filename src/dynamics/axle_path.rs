//! The kinematic bicycle model along a guide: paths of vehicles that are steered by the front and follow with the rear axle, and the speeds
//! at which they can be driven.

use std::f64::consts::PI;

use super::{Pose, speeds};
use crate::geometry::{Polyline, Vec2, direction, wrap};
use crate::scene::{AgentState, DT, FUTURE};

/// Distance between two poses of the path, metres.
const STEP: f64 = 0.1;
/// Largest curvature of the rear axle's path, 1/m: about that of a car at full lock.
const STEERING: f64 = 0.26;
/// Largest change of the curvature along the path, 1/m per m.
const STEERING_RATE: f64 = 0.15;
/// Largest lateral acceleration, m/s².
const LATERAL: f64 = 3.8;
/// Braking for a curve ahead, m/s².
const BRAKE_FOR_CURVE: f64 = 4.0;
/// Curvature that a step may show by the metric's formula, 1/m; the metric's bound is 0.3.
const CURVATURE: f64 = 0.295;
/// The metric takes no curvature from slower steps, m/s.
const CURVATURE_FROM: f64 = 0.6;
/// The rear axle lies this share of the length behind the box centre (nuPlan's vehicle: 1.461 m of 5.176 m).
pub const REAR_AXLE: f64 = 0.28;

/// Poses of the box centre, 0.1 m apart along the path of the rear axle.
///
/// The path is driven by the rear axle because a vehicle's heading is the direction in which that moves; the box centre swings
/// out in curves, as it does in logs.
#[derive(Clone, Debug)]
pub struct AxlePath {
    centers: Vec<Vec2>,
    headings: Vec<f64>,
    /// Way of the centre up to each pose, metres.
    arc: Vec<f64>,
    /// Curvature of the centre's way from each pose to the next, 1/m.
    curvatures: Vec<f64>,
    /// Where the vehicle must have stopped, if anywhere, metres.
    end: Option<f64>,
    /// Largest lateral acceleration, m/s².
    lateral: f64,
    /// The speed limit at each pose, m/s; empty where there is none.
    limits: Vec<f64>,
}

/// Where a vehicle sets out, and how.
#[derive(Clone, Copy, Debug)]
pub struct Departure {
    /// Box centre and heading.
    pub pose: Pose,
    /// How far the rear axle lies behind the box centre, metres.
    pub rear: f64,
    /// Whether it goes backwards.
    pub reverse: bool,
    /// Curvature of the rear axle's path, 1/m; `None` takes what the guide asks for.
    pub curvature: Option<f64>,
    /// How fast the wheel is turned at most: change of that curvature, 1/m per second.
    pub steering_speed: f64,
}

/// A calm turn of the wheel, 1/m per second: about 40 degrees per second at the road wheels of a car.
pub const CALM_STEERING: f64 = 0.25;

impl AxlePath {
    /// Drives the rear axle along `guide` (its own way, metres) from the exact pose of `from`, for `reach` metres: pure pursuit
    /// (Coulter, 1992) with bounded curvature, whose look-ahead grows with the speed expected after so many metres (`pace`, m/s),
    /// so that a recorder's noise does not become lateral acceleration.
    pub fn trace(guide: &Polyline, from: &Departure, reach: f64, pace: impl Fn(f64) -> f64) -> Self {
        let flip = if from.reverse { PI } else { 0.0 };
        let Pose { position, heading } = from.pose;
        let mut course = heading + flip;
        let mut axle = position - direction(heading) * from.rear;
        let count = (reach / STEP) as usize + 2;
        let mut path = Self {
            centers: vec![position],
            headings: vec![heading],
            arc: vec![0.0],
            curvatures: Vec::with_capacity(count),
            end: None,
            lateral: LATERAL,
            limits: Vec::new(),
        };
        let (mut curvature, mut segment) = (from.curvature, 0);
        for _ in 0..count {
            let nearest = guide.project_between(axle, segment, segment + 12);
            segment = nearest.segment;
            // Beyond the last segment the projection stops; the way beyond it goes on straight.
            let s = nearest.s + if nearest.t >= 1.0 { past_end(guide, axle) } else { 0.0 };
            let driven = path.arc[path.arc.len() - 1];
            let pace = pace(driven);
            let target = guide.at(s + (0.5 * pace).clamp(2.2, 10.0)) - axle;
            let bend = 2.0 * direction(course).perp(&target) / target.norm_squared().max(1.0);
            let change = STEERING_RATE.min(from.steering_speed / pace.max(0.1)) * STEP;
            let bend =
                curvature.map_or(bend, |c| bend.clamp(c - change, c + change)).clamp(-STEERING, STEERING);
            curvature = Some(bend);
            axle += direction(course + 0.5 * bend * STEP) * STEP;
            course += bend * STEP;
            let heading = course - flip;
            let center = axle + direction(heading) * from.rear;
            let way = (center - path.centers[path.centers.len() - 1]).norm();
            let turn = wrap(heading - path.headings[path.headings.len() - 1]).abs();
            path.curvatures.push(turn / way.max(0.5 * STEP));
            path.arc.push(path.arc[path.arc.len() - 1] + way.max(1e-9));
            path.centers.push(center);
            path.headings.push(wrap(heading));
        }
        path
    }

    /// Number of poses.
    pub fn poses(&self) -> usize {
        self.centers.len()
    }

    /// A pose, 0.1 m of the rear axle's way after the one before, and the way of the centre up to it, metres.
    pub fn pose(&self, index: usize) -> (Pose, f64) {
        (Pose { position: self.centers[index], heading: self.headings[index] }, self.arc[index])
    }

    /// The way of the box centre as a line with a point every half metre.
    pub fn centre_line(&self) -> Polyline {
        let points: Vec<Vec2> = self.centers.iter().step_by(5).copied().collect();
        let ahead = self.centers[0] + direction(self.headings[0]);
        Polyline::new(&points)
            .unwrap_or_else(|_| Polyline::new(&[self.centers[0], ahead]).expect("two points a metre apart"))
    }

    /// The pose that the rear axle reaches after so many metres of its own way.
    pub fn index_of_axle(&self, way: f64) -> usize {
        ((way / STEP) as usize).min(self.arc.len() - 1)
    }

    /// Sets the largest lateral acceleration, m/s² (3.8 otherwise).
    pub fn limit_lateral(&mut self, acceleration: f64) {
        self.lateral = acceleration;
    }

    /// Sets the speed limit, m/s, after so many metres of the way of the box centre.
    pub fn limit_speed(&mut self, limit: impl Fn(f64) -> f64) {
        self.limits = self.arc.iter().map(|&s| limit(s)).collect();
    }

    /// Makes the path end with a halt after `s` metres.
    pub fn stop_at(&mut self, s: f64) {
        self.end = Some(s);
    }

    fn locate(&self, s: f64) -> (usize, f64) {
        let i = self.arc.partition_point(|&a| a <= s).clamp(1, self.arc.len() - 1) - 1;
        (i, (s - self.arc[i]) / (self.arc[i + 1] - self.arc[i]))
    }

    /// As [`Self::locate`], by walking from the pose `near`: quicker for an `s` close to it.
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

    /// The box centre after `s` metres.
    pub fn position(&self, s: f64) -> Vec2 {
        self.between(self.locate(s))
    }

    /// The heading of the AV after `s` metres, radians.
    pub fn heading(&self, s: f64) -> f64 {
        let (i, t) = self.locate(s);
        wrap(self.headings[i] + wrap(self.headings[i + 1] - self.headings[i]) * t)
    }

    /// How far along the path the centre is exactly `distance` metres, as the crow flies, from `from`, where it was at `s`.
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

    /// The speed that curves (and the end, where there is one) allow at each pose, braking for those ahead included.
    pub fn allowed_speeds(&self) -> Allowed<'_> {
        let mut speeds: Vec<f64> = Vec::with_capacity(self.arc.len());
        for (i, &s) in self.arc.iter().enumerate() {
            let curvature = self.curvatures[i.min(self.curvatures.len() - 1)];
            let over = self.end.is_some_and(|end| s >= end);
            let limit = self.limits.get(i).copied().unwrap_or(f64::INFINITY);
            speeds.push(if over { 0.0 } else { (self.lateral / curvature.max(1e-6)).sqrt().min(limit) });
        }
        for i in (0..speeds.len() - 1).rev() {
            let way = self.arc[i + 1] - self.arc[i];
            speeds[i] = speeds[i].min((speeds[i + 1] * speeds[i + 1] + 2.0 * BRAKE_FOR_CURVE * way).sqrt());
        }
        Allowed { path: self, speeds }
    }
}

/// The speed allowed along a path.
pub struct Allowed<'a> {
    path: &'a AxlePath,
    speeds: Vec<f64>,
}

impl Allowed<'_> {
    /// The speed allowed after `s` metres, m/s.
    pub fn at(&self, s: f64) -> f64 {
        let (i, t) = self.path.locate(s);
        self.speeds[i] + (self.speeds[i + 1] - self.speeds[i]) * t.min(1.0)
    }
}

/// Drives along a path from the state `now`, at the speed `speed_now` (m/s, in the direction of the path), at the desired speeds as
/// far as the path and the limits of the metrics allow: one state per step. A vehicle at rest keeps its state exactly.
pub fn follow(now: AgentState, speed_now: f64, path: &AxlePath, desired: &[f64]) -> Vec<AgentState> {
    drive(now, speed_now, path, desired, Some(&path.allowed_speeds()))
}

/// As [`follow`], smoothly: for a vehicle that speeds up by `acceleration` (m/s²) until now, with changes of the acceleration spread
/// ([`speeds::soften_from`]). Bends are taken, and the path's end is reached, nearly at the speeds that [`follow`] finds.
pub fn follow_smoothly(
    now: AgentState,
    speed_now: f64,
    acceleration: f64,
    path: &AxlePath,
    desired: &[f64],
) -> Vec<AgentState> {
    let found = follow(now, speed_now, path, desired);
    let mut found: Vec<f64> = found.iter().map(AgentState::speed).collect();
    speeds::soften_from(speed_now, acceleration, &mut found);
    drive(now, speed_now, path, &found, None)
}

/// Drives along a path at the desired speeds, below those that are allowed.
fn drive(
    now: AgentState,
    speed_now: f64,
    path: &AxlePath,
    desired: &[f64],
    allowed: Option<&Allowed<'_>>,
) -> Vec<AgentState> {
    let (mut s, mut speed, mut state) = (0.0, speed_now, now);
    // Change of speed in the last step, and whether a curve keeps the AV below what is desired.
    let (mut change, mut held) = (0.0, false);
    let mut track = Vec::with_capacity(FUTURE);
    for &wanted in desired {
        // A look ahead gives the braking force time to rise.
        let ceiling = allowed.map_or(f64::INFINITY, |allowed| {
            allowed.at(s + 0.5 * (speed + wanted) * DT).min(allowed.at(s + 4.0 * speed * DT))
        });
        held = ceiling < wanted || (held && speed < wanted - speeds::EASE);
        let aim = if held {
            let least = (change - 2.0 * speeds::EASE).max(-speeds::LOSS);
            let most = (change + speeds::EASE).clamp(least, speeds::GAIN);
            speed + (wanted.min(ceiling) - speed).clamp(least, most)
        } else {
            wanted
        };
        let mut next = aim.clamp((speed - speeds::CHANGE).max(0.0), speed + speeds::CHANGE);
        if held {
            next = speeds::halted(next);
        }
        let mut reached = path.advance(s, state.position(), next * DT);
        // A step that speeds up turns more than its mean speed accounts for: speed up less there.
        for _ in 0..8 {
            let turn = wrap(path.heading(reached) - state.heading).abs();
            let judged = speed >= CURVATURE_FROM && next >= CURVATURE_FROM;
            if next <= speed || !judged || turn <= CURVATURE * 0.5 * (speed + next) * DT {
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

/// How far `p` lies beyond the end of a polyline, along its last segment, metres.
fn past_end(line: &Polyline, p: Vec2) -> f64 {
    let end = line.points()[line.segments()];
    (p - end).dot(&direction(line.heading(line.segments() - 1))).max(0.0)
}
