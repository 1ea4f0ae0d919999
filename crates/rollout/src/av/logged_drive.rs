//! The logged drive of the AV in a form that can be driven again: its smoothed path, extended beyond its
//! end and shifted sideways on request, and its speeds.

use std::f64::consts::PI;

use reactsim_geometry::{OrientedBox, Polyline, Vec2, direction, heading_of, left, smooth_step, wrap};
use reactsim_scene::dynamics::{AxlePath, CALM_STEERING_RATE, Departure, Pose, REAR_AXLE, STANDSTILL_SPEED};
use reactsim_scene::{AgentState, DT, Frame, LaneHit, Road, Scenario};

use super::{AvError, LogAv, MAX_STEP_DISPLACEMENT, check_steps};

/// Smallest distance between recorded points, metres: closer ones are dropped, because their direction
/// is noise.
const MIN_POINT_SPACING: f64 = 0.5;
/// Backward displacement that ends a path, metres: the AV changed gear.
const GEAR_CHANGE_DISPLACEMENT: f64 = 1.0;
/// Displacement over the history below which an agent counts as parked, metres.
const PARKED_DISPLACEMENT: f64 = 0.3;
/// Clearance to obstacles beyond the end of the log, metres.
const OBSTACLE_CLEARANCE: f64 = 0.5;
/// Largest distance from a lane at which the end of the log counts as on it, metres.
const ON_LANE_DISTANCE: f64 = 2.0;
/// Largest angle to a lane at which the end of the log counts as on it, radians.
const ON_LANE_ANGLE: f64 = PI / 6.0;

/// The logged drive of the AV from the current frame on, with smoothed speeds.
#[derive(Clone, Debug)]
pub struct LoggedDrive {
    /// States from step 0 on.
    states: Vec<AgentState>,
    /// 1 if the AV drives forwards, -1 if it reverses.
    gear: f64,
    /// Speed along the path from step 0 on, m/s, smoothed (except the first, which is the recorded
    /// one); never negative, and exactly 0 while the AV is stationary.
    speeds: Vec<f64>,
}

impl LoggedDrive {
    /// Reads the logged drive of the AV of a scenario.
    ///
    /// # Errors
    /// [`AvError`] when the AV is absent at a step, or jumps.
    pub fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let mut states = vec![scenario.start.now(0)];
        states.extend(LogAv::new(scenario)?.track);
        // A jump would count as speed, and make the path as long as that speed requires.
        check_steps(&states[0], &states[1..])?;
        let gear = gear(&states, velocity_now(scenario));
        let speeds = speeds(scenario, &states, gear);
        Ok(Self { states, gear, speeds })
    }

    /// Returns the states from step 0 on.
    pub fn states(&self) -> &[AgentState] {
        &self.states
    }

    /// Returns the speeds along the path from step 0 on, m/s; never negative, and exactly 0 while the
    /// AV is stationary.
    pub fn speeds(&self) -> &[f64] {
        &self.speeds
    }

    /// Returns whether the AV reverses.
    pub fn reverses(&self) -> bool {
        self.gear < 0.0
    }

    /// Returns the logged path for an AV that is to travel `travel` metres.
    ///
    /// `aside` shifts the path: metres to the left as a function of the distance along it. `curvature`
    /// is the current curvature of the rear-axle path (1/m), which then changes at the rate of calm
    /// steering; with `None` the path starts with the curvature of pure pursuit.
    pub fn path(
        &self,
        scenario: &Scenario,
        aside: Option<&dyn Fn(f64) -> f64>,
        curvature: Option<f64>,
        travel: f64,
    ) -> AxlePath {
        let reach = travel + 10.0;
        let rear = REAR_AXLE * scenario.start.agents[0].length;
        let (guide, logged_length, cusp) = guide(scenario, self, rear, aside, reach);
        let now = self.states[0];
        let from = Departure {
            pose: Pose::from(now),
            rear,
            reverse: self.reverses(),
            curvature,
            steering_speed: if curvature.is_some() { CALM_STEERING_RATE } else { f64::INFINITY },
        };
        let paces = paces(self);
        let pace = |driven: f64| paces[paces.partition_point(|p| p.0 <= driven).clamp(1, paces.len()) - 1].1;
        let mut path = AxlePath::trace(&guide, &from, reach, pace);
        // The guide is the rear-axle path; the end is needed along the centre path, which is never
        // shorter.
        let last = path.index_of_axle(logged_length);
        let end = path.pose(last).1;
        if cusp {
            path.stop_at(end);
        } else if travel > end + 1.0
            && let Some(end) = blocked_beyond(&path, scenario, last)
        {
            path.stop_at(end);
        }
        path
    }
}

/// Returns the AV's current forward speed, m/s, negative in reverse: the recorded one, else from the
/// position difference, else 0.
pub(super) fn velocity_now(scenario: &Scenario) -> f64 {
    let now = scenario.start.now(0);
    if now.velocity().is_some() {
        // The magnitude of the velocity, as in the metrics, unless the AV moves sideways.
        let (forward, speed) = (now.forward_speed(), now.speed());
        return if forward.abs() > 0.5 * speed { speed.copysign(forward) } else { forward };
    }
    let before: Frame = scenario.start.history[0][scenario.start.current() - 1];
    let displacement = before.map_or(0.0, |b| (now.position() - b.position()).dot(&direction(now.heading)));
    // A jump is not motion.
    if displacement.abs() > MAX_STEP_DISPLACEMENT { 0.0 } else { displacement / DT }
}

/// Returns whether the AV drives forwards (1) or backwards (-1): from its speed or, if it is stationary,
/// from how it sets off.
fn gear(states: &[AgentState], velocity: f64) -> f64 {
    let ahead = direction(states[0].heading);
    let mut moves = states.iter().map(|s| s.position() - states[0].position());
    let forwards = if velocity.abs() > 0.3 {
        velocity > 0.0
    } else {
        moves.find(|d| d.norm() >= MIN_POINT_SPACING).is_none_or(|d| d.dot(&ahead) > 0.0)
    };
    if forwards { 1.0 } else { -1.0 }
}

/// Computes speeds along the path from differences over up to 0.6 s, which average out the noise of
/// recorded positions.
fn speeds(scenario: &Scenario, states: &[AgentState], gear: f64) -> Vec<f64> {
    const HALF_WINDOW: usize = 3;
    let (history, now) = (&scenario.start.history[0], scenario.start.current());
    let at = |frame: usize| -> Frame {
        if frame < now { history[frame] } else { states.get(frame - now).copied() }
    };
    let mut speeds = Vec::with_capacity(states.len());
    for (step, state) in states.iter().enumerate() {
        let frame = step + now;
        let ahead = direction(state.heading) * gear;
        let reach = HALF_WINDOW.min(states.len() - 1 - step).min(frame);
        // Displacement of the box centre, which is not quite along the heading in curves.
        let displacement = |from: &AgentState, to: &AgentState| {
            let d = to.position() - from.position();
            d.norm().copysign(d.dot(&ahead))
        };
        let raw = match (step, at(frame - reach), at(frame + reach)) {
            (0, ..) => velocity_now(scenario) * gear,
            (_, Some(a), Some(b)) if reach > 0 => displacement(&a, &b) / (2.0 * reach as f64 * DT),
            _ => displacement(&states[step - 1], state) / DT,
        };
        speeds.push(if raw < STANDSTILL_SPEED { 0.0 } else { raw });
    }
    speeds
}

/// Returns the arc length at which the path after the pose `last`, where the log ends, meets an agent
/// that has been parked since the start or an obstacle, metres. The logged path is known to be free; its
/// extension is a guess, which must not run into parked cars.
fn blocked_beyond(path: &AxlePath, scenario: &Scenario, last: usize) -> Option<f64> {
    let start = &scenario.start;
    let is_parked = |&j: &usize| {
        let mut seen = start.history[j].iter().flatten();
        let first = seen.next().map(|s| s.position());
        first.is_some_and(|p| (start.now(j).position() - p).norm() < PARKED_DISPLACEMENT)
    };
    let others = (1..start.agents.len()).filter(is_parked).map(|j| start.now(j).footprint(&start.agents[j]));
    let parked: Vec<OrientedBox> = others.chain(start.obstacles.iter().copied()).collect();
    let av = &start.agents[0];
    let meets = |i: usize, o: &OrientedBox| {
        let (pose, _) = path.pose(i);
        let own = OrientedBox::new(pose.position, pose.heading, av.length, av.width);
        (o.center - own.center).norm() < 30.0 && o.separation(&own) < OBSTACLE_CLEARANCE
    };
    // Obstacles within the clearance at the end of the log are next to the AV, not in its path.
    let ahead: Vec<OrientedBox> = parked.into_iter().filter(|o| !meets(last, o)).collect();
    // The stop is a little short of the first contact.
    let first = (last..path.poses()).step_by(5).find(|i| ahead.iter().any(|o| meets(*i, o)))?;
    Some((path.pose(first).1 - OBSTACLE_CLEARANCE).max(path.pose(last).1))
}

/// Returns the guide line of the rear axle, the length of its logged part, and whether that part ends
/// with a change of gear.
fn guide(
    scenario: &Scenario,
    log: &LoggedDrive,
    rear: f64,
    aside: Option<&dyn Fn(f64) -> f64>,
    reach: f64,
) -> (Polyline, f64, bool) {
    let axle = |k: usize| log.states[k].position() - direction(log.states[k].heading) * rear;
    let ahead = |k: usize| direction(log.states[k].heading) * log.gear;
    let (mut indices, mut arc, mut cusp) = (vec![0], vec![0.0], false);
    for k in 1..log.states.len() {
        let last = indices[indices.len() - 1];
        let step = axle(k) - axle(last);
        let forward = step.dot(&ahead(k));
        if forward < -GEAR_CHANGE_DISPLACEMENT {
            cusp = true;
            break;
        }
        if forward > 0.0 && step.norm() >= MIN_POINT_SPACING {
            indices.push(k);
            arc.push(arc[arc.len() - 1] + step.norm());
        }
    }
    let logged_length = arc[arc.len() - 1];
    let last = indices[indices.len() - 1];
    let mut points: Vec<Vec2> = indices.iter().map(|&k| axle(k)).collect();
    let mut normals: Vec<Vec2> = indices.iter().map(|&k| left(ahead(k)) * log.gear).collect();
    let beyond = if cusp { Vec::new() } else { beyond(scenario, axle(last), ahead(last), log.gear, reach) };
    if beyond.is_empty() {
        // One more point defines the direction in which the polyline is extended.
        points.push(axle(last) + ahead(last));
        normals.push(normals[normals.len() - 1]);
        arc.push(logged_length + 1.0);
    }
    for (p, heading) in beyond {
        arc.push(arc[arc.len() - 1] + (p - points[points.len() - 1]).norm());
        points.push(p);
        normals.push(left(direction(heading)));
    }
    if let Some(aside) = aside {
        // A straight guide has too few points to bend.
        (points, normals, arc) = refine(&points, &normals, &arc, reach);
        for ((p, normal), s) in points.iter_mut().zip(&normals).zip(&arc) {
            *p += normal * aside(*s);
        }
    }
    let guide = Polyline::new(&points).unwrap_or_else(|_| {
        let start = axle(0);
        Polyline::new(&[start, start + ahead(0)]).expect("two points a metre apart")
    });
    (guide, logged_length, cusp)
}

/// Returns the same guide with a point at least every metre, extended to `reach`.
fn refine(points: &[Vec2], normals: &[Vec2], arc: &[f64], reach: f64) -> (Vec<Vec2>, Vec<Vec2>, Vec<f64>) {
    let (mut p, mut n, mut a) = (vec![points[0]], vec![normals[0]], vec![arc[0]]);
    for i in 1..points.len() {
        let distance = arc[i] - arc[i - 1];
        let last = if i + 1 == points.len() { (reach - arc[i - 1]).max(distance) } else { distance };
        let pieces = last.ceil().max(1.0) as usize;
        for k in 1..=pieces {
            let s = last * k as f64 / pieces as f64;
            p.push(points[i - 1] + (points[i] - points[i - 1]) * (s / distance));
            let normal = normals[i - 1] + (normals[i] - normals[i - 1]) * (s / distance).min(1.0);
            n.push(if normal.norm() > 0.1 { normal.normalize() } else { normals[i] });
            a.push(arc[i - 1] + s);
        }
    }
    (p, n, a)
}

/// Returns points (with directions) of the lane that continues from the end of the log; none if the AV
/// is on no lane or reverses.
///
/// They leave the logged direction smoothly and keep the distance from the centre line, because there
/// may be parked cars next to the AV.
fn beyond(scenario: &Scenario, at: Vec2, ahead: Vec2, gear: f64, reach: f64) -> Vec<(Vec2, f64)> {
    let road = scenario.start.road_at(0);
    let heading = heading_of(ahead);
    let mut hits: Vec<LaneHit> = Vec::new();
    if gear > 0.0 {
        road.lanes_near(at, ON_LANE_DISTANCE, &mut hits);
    }
    let off = |h: &LaneHit| {
        let turn = wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
        (turn, turn * 4.0 + h.projection.distance)
    };
    hits.retain(|h| off(h).0 < ON_LANE_ANGLE && h.projection.t < 1.0);
    let Some(hit) = hits.iter().min_by(|a, b| off(a).1.total_cmp(&off(b).1)) else { return Vec::new() };
    let (mut lane, mut s) = (hit.lane, hit.projection.s);
    let join = 20.0;
    let (mut points, mut distance) = (Vec::new(), 0.0);
    while distance < reach {
        let line = &road.lane(lane).baseline;
        while s < line.length() && distance < reach {
            (s, distance) = (s + 1.0, distance + 1.0);
            let turn = line.heading_at(s);
            let on_lane = line.at(s.min(line.length())) + left(direction(turn)) * hit.projection.offset;
            let straight = at + ahead * distance;
            points.push((straight + (on_lane - straight) * smooth_step(distance / join), turn));
        }
        match straightest(&road, lane) {
            Some(next) => (lane, s) = (next, 0.0),
            None => break,
        }
    }
    points
}

/// Returns the successor that turns least over its first 20 m.
fn straightest(road: &Road<'_>, lane: usize) -> Option<usize> {
    let line = &road.lane(lane).baseline;
    let end = line.heading(line.segments() - 1);
    let turn = |&next: &usize| {
        let next = &road.lane(next).baseline;
        wrap(next.heading_at(next.length().min(20.0)) - end).abs() + 0.1 * wrap(next.heading(0) - end).abs()
    };
    road.lane(lane).successors.iter().copied().min_by(|a, b| turn(a).total_cmp(&turn(b)))
}

/// Returns the speeds of the log as a function of distance driven: metres, and m/s from there on.
fn paces(log: &LoggedDrive) -> Vec<(f64, f64)> {
    let mut driven = 0.0;
    let step = |&speed: &f64| {
        let from = driven;
        driven += speed * DT;
        (from, speed)
    };
    log.speeds.iter().map(step).collect()
}
