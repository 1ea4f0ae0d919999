//! The logged AV as something that can be driven again: its way made smooth, gone on with beyond its end, moved sideways where that is
//! asked, and its speeds.

use std::f64::consts::PI;

use super::{AvError, LONGEST_STEP, check_steps};
use crate::dynamics::{AxlePath, CALM_STEERING, Departure, Pose, REAR_AXLE};
use crate::geometry::{OrientedBox, Polyline, Vec2, direction, heading_of, left, smooth_step, wrap};
use crate::scene::{AgentState, CURRENT, DT, Frame, LaneHit, Road, Scenario};

/// Recorded points closer than this are dropped, metres: they tell noise, not direction.
const SPACING: f64 = 0.5;
/// Rolling back farther than this ends a path, metres: the AV changed gear.
const CUSP: f64 = 1.0;
/// Who has moved less than this in the history stood, metres.
const STOOD: f64 = 0.3;
/// Room that is kept to what stands beyond the end of the log, metres.
const ROOM: f64 = 0.5;
/// Largest distance and angle at which the end of the log counts as on a lane, metres and radians.
const ON_LANE: (f64, f64) = (2.0, PI / 6.0);
/// Slower than this an AV stands (m/s): recorded positions of a standing AV jitter by a centimetre or two.
pub(super) const STANDING: f64 = 0.1;

/// The logged AV from the current frame on.
///
/// Positions are made smooth, since a recorder's noise is no driving.
#[derive(Clone, Debug)]
pub struct LoggedDrive {
    /// States at steps 0 to 80.
    states: Vec<AgentState>,
    /// 1 where the AV drives forwards, -1 where it reverses.
    gear: f64,
    /// Speed along the path at steps 0 to 80, m/s, smoothed (but for the first, which is the recorded one); exactly 0 while
    /// the AV stands. Never negative.
    speeds: Vec<f64>,
}

impl LoggedDrive {
    /// The logged AV of a scenario.
    ///
    /// # Errors
    /// [`AvError`] when the AV is absent at a step, or jumps.
    pub fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let future = &scenario.log_future.tracks[0];
        let mut states = vec![scenario.start.now(0)];
        for (i, frame) in future.iter().enumerate() {
            states.push(frame.ok_or(AvError::Absent { step: i + 1 })?);
        }
        // A jump would be taken for a speed, and the path made as long as that asks for.
        check_steps(&states[0], &states[1..])?;
        let gear = gear(&states, velocity_now(scenario));
        let speeds = speeds(scenario, &states, gear);
        Ok(Self { states, gear, speeds })
    }

    /// States at steps 0 to 80.
    pub fn states(&self) -> &[AgentState] {
        &self.states
    }

    /// Speeds along the path at steps 0 to 80, m/s, never negative; exactly 0 while the AV stands.
    pub fn speeds(&self) -> &[f64] {
        &self.speeds
    }

    /// Whether the AV reverses.
    pub fn reverses(&self) -> bool {
        self.gear < 0.0
    }

    /// The logged path for an AV that is to travel `travel` metres, moved sideways by `aside`: metres to the left after so many metres
    /// of the way. `curvature` is that of the rear axle's path now (1/m), from which the wheel is turned calmly; `None` takes what the path
    /// asks for.
    pub fn path(
        &self,
        scenario: &Scenario,
        aside: Option<&dyn Fn(f64) -> f64>,
        curvature: Option<f64>,
        travel: f64,
    ) -> AxlePath {
        let reach = travel + 10.0;
        let rear = REAR_AXLE * scenario.start.agents[0].length;
        let (guide, told, cusp) = guide(scenario, self, rear, aside, reach);
        let now = self.states[0];
        let from = Departure {
            pose: Pose::from(now),
            rear,
            reverse: self.reverses(),
            curvature,
            steering_speed: if curvature.is_some() { CALM_STEERING } else { f64::INFINITY },
        };
        let paces = paces(self);
        let pace = |driven: f64| paces[paces.partition_point(|p| p.0 <= driven).clamp(1, paces.len()) - 1].1;
        let mut path = AxlePath::trace(&guide, &from, reach, pace);
        // The guide is the rear axle's way; the end is wanted along the centre's, which is never shorter.
        let last = path.index_of_axle(told);
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

/// The AV's forward speed now, m/s, negative in reverse: the recorded one, else by position difference, else 0.
pub(super) fn velocity_now(scenario: &Scenario) -> f64 {
    let now = scenario.start.now(0);
    if now.velocity().is_some() {
        // The whole speed, as the metrics take it, unless the AV moves sideways.
        let (forward, speed) = (now.forward_speed(), now.speed());
        return if forward.abs() > 0.5 * speed { speed.copysign(forward) } else { forward };
    }
    let before: Frame = scenario.start.history[0][CURRENT - 1];
    let way = before.map_or(0.0, |b| (now.position() - b.position()).dot(&direction(now.heading)));
    // A jump is no speed.
    if way.abs() > LONGEST_STEP { 0.0 } else { way / DT }
}

/// Whether the AV drives forwards (1) or backwards (-1): by its speed or, where it stands, by how it sets off.
fn gear(states: &[AgentState], velocity: f64) -> f64 {
    let ahead = direction(states[0].heading);
    let mut moves = states.iter().map(|s| s.position() - states[0].position());
    let forwards = if velocity.abs() > 0.3 {
        velocity > 0.0
    } else {
        moves.find(|d| d.norm() >= SPACING).is_none_or(|d| d.dot(&ahead) > 0.0)
    };
    if forwards { 1.0 } else { -1.0 }
}

/// Speeds along the path by differences over up to 0.6 s, which average the noise of recorded positions out.
fn speeds(scenario: &Scenario, states: &[AgentState], gear: f64) -> Vec<f64> {
    const REACH: usize = 3;
    let history = &scenario.start.history[0];
    let at = |frame: usize| -> Frame {
        if frame < CURRENT { history[frame] } else { states.get(frame - CURRENT).copied() }
    };
    let mut speeds = Vec::with_capacity(states.len());
    for (step, state) in states.iter().enumerate() {
        let frame = step + CURRENT;
        let ahead = direction(state.heading) * gear;
        let reach = REACH.min(states.len() - 1 - step);
        // The way of the box centre, which is not quite along the heading in curves.
        let way = |from: &AgentState, to: &AgentState| {
            let way = to.position() - from.position();
            way.norm().copysign(way.dot(&ahead))
        };
        let raw = match (step, at(frame - reach), at(frame + reach)) {
            (0, ..) => velocity_now(scenario) * gear,
            (_, Some(a), Some(b)) if reach > 0 => way(&a, &b) / (2.0 * reach as f64 * DT),
            _ => way(&states[step - 1], state) / DT,
        };
        speeds.push(if raw < STANDING { 0.0 } else { raw });
    }
    speeds
}

/// Where the way beyond the pose `last`, at which the log ends, meets something that has stood since the start, metres. The log
/// tells that its own way is free; what lies beyond is the script's guess, which does not drive into parked cars.
fn blocked_beyond(path: &AxlePath, scenario: &Scenario, last: usize) -> Option<f64> {
    let start = &scenario.start;
    let stood = |&j: &usize| {
        let mut seen = start.history[j].iter().flatten();
        let first = seen.next().map(|s| s.position());
        first.is_some_and(|p| (start.now(j).position() - p).norm() < STOOD)
    };
    let others = (1..start.agents.len()).filter(stood).map(|j| start.now(j).footprint(&start.agents[j]));
    let standing: Vec<OrientedBox> = others.chain(start.obstacles.iter().copied()).collect();
    let av = &start.agents[0];
    let meets = |i: usize, o: &OrientedBox| {
        let (pose, _) = path.pose(i);
        let own = OrientedBox::new(pose.position, pose.heading, av.length, av.width);
        (o.center - own.center).norm() < 30.0 && o.separation(&own) < ROOM
    };
    // What the log leaves less room to at its end stands beside the AV, not in its way.
    let ahead: Vec<OrientedBox> = standing.into_iter().filter(|o| !meets(last, o)).collect();
    // The stop is a little short of the first contact.
    let first = (last..path.poses()).step_by(5).find(|i| ahead.iter().any(|o| meets(*i, o)))?;
    Some((path.pose(first).1 - ROOM).max(path.pose(last).1))
}

/// Where the rear axle is to go, how long the way is that the log tells, and whether it ends there by a change of gear.
fn guide(
    scenario: &Scenario,
    log: &LoggedDrive,
    rear: f64,
    aside: Option<&dyn Fn(f64) -> f64>,
    reach: f64,
) -> (Polyline, f64, bool) {
    let axle = |k: usize| log.states[k].position() - direction(log.states[k].heading) * rear;
    let ahead = |k: usize| direction(log.states[k].heading) * log.gear;
    let (mut kept, mut arc, mut cusp) = (vec![0], vec![0.0], false);
    for k in 1..log.states.len() {
        let last = kept[kept.len() - 1];
        let step = axle(k) - axle(last);
        let forward = step.dot(&ahead(k));
        if forward < -CUSP {
            cusp = true;
            break;
        }
        if forward > 0.0 && step.norm() >= SPACING {
            kept.push(k);
            arc.push(arc[arc.len() - 1] + step.norm());
        }
    }
    let told = arc[arc.len() - 1];
    let last = kept[kept.len() - 1];
    let mut points: Vec<Vec2> = kept.iter().map(|&k| axle(k)).collect();
    let mut normals: Vec<Vec2> = kept.iter().map(|&k| left(ahead(k)) * log.gear).collect();
    let beyond = if cusp { Vec::new() } else { beyond(scenario, axle(last), ahead(last), log.gear, reach) };
    if beyond.is_empty() {
        // One more point gives the direction in which the polyline goes on.
        points.push(axle(last) + ahead(last));
        normals.push(normals[normals.len() - 1]);
        arc.push(told + 1.0);
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
    (guide, told, cusp)
}

/// The same guide with a point at least every metre, and on to `reach`.
fn refine(points: &[Vec2], normals: &[Vec2], arc: &[f64], reach: f64) -> (Vec<Vec2>, Vec<Vec2>, Vec<f64>) {
    let (mut p, mut n, mut a) = (vec![points[0]], vec![normals[0]], vec![arc[0]]);
    for i in 1..points.len() {
        let way = arc[i] - arc[i - 1];
        let last = if i + 1 == points.len() { (reach - arc[i - 1]).max(way) } else { way };
        let pieces = last.ceil().max(1.0) as usize;
        for k in 1..=pieces {
            let s = last * k as f64 / pieces as f64;
            p.push(points[i - 1] + (points[i] - points[i - 1]) * (s / way));
            let normal = normals[i - 1] + (normals[i] - normals[i - 1]) * (s / way).min(1.0);
            n.push(if normal.norm() > 0.1 { normal.normalize() } else { normals[i] });
            a.push(arc[i - 1] + s);
        }
    }
    (p, n, a)
}

/// Points (with directions) of the lane that goes on from the end of the log, or none where the AV is on no lane or reverses.
/// They leave the logged direction smoothly and keep the distance from the centre line: there may be parked cars beside the AV.
fn beyond(scenario: &Scenario, at: Vec2, ahead: Vec2, gear: f64, reach: f64) -> Vec<(Vec2, f64)> {
    let road = scenario.start.road();
    let heading = heading_of(ahead);
    let mut hits: Vec<LaneHit> = Vec::new();
    if gear > 0.0 {
        road.lanes_near(at, ON_LANE.0, &mut hits);
    }
    let off = |h: &LaneHit| {
        let turn = wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
        (turn, turn * 4.0 + h.projection.distance)
    };
    hits.retain(|h| off(h).0 < ON_LANE.1 && h.projection.t < 1.0);
    let Some(hit) = hits.iter().min_by(|a, b| off(a).1.total_cmp(&off(b).1)) else { return Vec::new() };
    let (mut lane, mut s) = (hit.lane, hit.projection.s);
    let join = 20.0;
    let (mut points, mut way) = (Vec::new(), 0.0);
    while way < reach {
        let line = &road.lane(lane).baseline;
        while s < line.length() && way < reach {
            (s, way) = (s + 1.0, way + 1.0);
            let turn = line.heading_at(s);
            let on_lane = line.at(s.min(line.length())) + left(direction(turn)) * hit.projection.offset;
            let straight = at + ahead * way;
            points.push((straight + (on_lane - straight) * smooth_step(way / join), turn));
        }
        match straightest(&road, lane) {
            Some(next) => (lane, s) = (next, 0.0),
            None => break,
        }
    }
    points
}

/// The successor that turns least over its first 20 m.
fn straightest(road: &Road<'_>, lane: usize) -> Option<usize> {
    let line = &road.lane(lane).baseline;
    let end = line.heading(line.segments() - 1);
    let turn = |&next: &usize| {
        let next = &road.lane(next).baseline;
        wrap(next.heading_at(next.length().min(20.0)) - end).abs() + 0.1 * wrap(next.heading(0) - end).abs()
    };
    road.lane(lane).successors.iter().copied().min_by(|a, b| turn(a).total_cmp(&turn(b)))
}

/// The speeds of the log by the way driven: metres, and m/s from there on.
fn paces(log: &LoggedDrive) -> Vec<(f64, f64)> {
    let mut driven = 0.0;
    let step = |&speed: &f64| {
        let from = driven;
        driven += speed * DT;
        (from, speed)
    };
    log.speeds.iter().map(step).collect()
}
