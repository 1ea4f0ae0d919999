//! Routes over the lane graph other than the logged one.

use reactsim_geometry::{Bounds, Polyline, Vec2, direction, left, smooth_step, wrap};
use reactsim_scene::dynamics::{AxlePath, CALM_STEERING_RATE, Departure, Pose, REAR_AXLE};
use reactsim_scene::{AgentKind, DT, LaneClass, LaneHit, Road, Scenario, Start};

use super::limits::{LaneTolerance, Limits, MAX_LATERAL_ACCELERATION, lane_along};

/// Tolerances of the AV's own lane.
const OWN_LANE: LaneTolerance = LaneTolerance { distance: 2.2, angle: 0.6 };
/// Tolerances of an adjacent lane, from which the AV may turn off too.
const ADJACENT_LANE: LaneTolerance = LaneTolerance { distance: 4.5, angle: 0.3 };
/// Distance within which the AV joins the centre line of its lane, metres.
const JOIN_DISTANCE: f64 = 20.0;
/// Smallest duration of a change to the adjacent lane, s.
const LANE_CHANGE_TIME: f64 = 2.5;
/// Largest number of routes considered.
const MAX_ROUTES: usize = 48;
/// Distance beyond which two routes have diverged, metres.
const DIVERGENCE_DISTANCE: f64 = 2.5;
/// Angle beyond which two routes have diverged, radians.
const DIVERGENCE_ANGLE: f64 = 0.26;
/// Length over which a bend is measured, and within which it is anticipated, metres.
const BEND_LENGTH: f64 = 6.0;
/// Expected acceleration of an AV that sets off, m/s².
const START_ACCELERATION: f64 = 1.5;
/// Smallest expected speed for steering, m/s.
const MIN_STEERING_SPEED: f64 = 1.5;
/// Smallest expected speed in a bend, m/s.
const MIN_BEND_SPEED: f64 = 2.5;
/// Smallest lateral distance that counts as a lane change, metres.
const MIN_LANE_CHANGE: f64 = 2.5;
/// Number of points at which the extension of a lane ends.
const MAX_LANE_POINTS: usize = 4000;
/// Distance below which a vehicle is on a path, metres.
const ON_PATH_DISTANCE: f64 = 2.5;
/// Speed above which a vehicle counts as moving, m/s.
const MOVING_SPEED: f64 = 1.0;
/// Distance up to which entries are ignored, metres: they belong to the AV's current neighbours.
const MIN_ENTRY_DISTANCE: f64 = 5.0;
/// Distance between the ends of two routes up to which they are the same, metres.
const SAME_END_DISTANCE: f64 = 4.0;

/// A route other than the logged one.
pub(super) struct Branch {
    /// Guide line of the rear axle.
    guide: Polyline,
    /// Path that the AV drives; it ends where the lanes end.
    pub(super) path: AxlePath,
    /// Total turn, radians, left positive.
    turn: f64,
    /// Points where others enter it under log replay.
    pub(super) path_entries: Vec<PathEntry>,
}

/// Entry of another vehicle onto a path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathEntry {
    /// Arc length along the path, metres.
    pub(super) s: f64,
    /// Time from now, s.
    pub(super) time: f64,
}

impl Branch {
    /// Returns the description of the route in words.
    pub(super) fn name(&self) -> &'static str {
        match self.turn.to_degrees() {
            t if t > 120.0 => "sharp left",
            t if t > 35.0 => "turn left",
            t if t > 10.0 => "bear left",
            t if t < -120.0 => "sharp right",
            t if t < -35.0 => "turn right",
            t if t < -10.0 => "bear right",
            _ => "straight on",
        }
    }
}

/// A route over the lane graph from where the AV is.
pub(super) struct Route {
    /// Guide line of the rear axle.
    pub(super) guide: Polyline,
    /// Total turn, radians, left positive.
    turn: f64,
}

/// Returns the routes from the AV's lane that leave the logged path within `reach` metres.
///
/// `logged` is the logged path of the box centre, `curvature` the current curvature of the AV's
/// rear-axle path (1/m).
pub(super) fn branches(scenario: &Scenario, logged: &Polyline, curvature: f64, reach: f64) -> Vec<Branch> {
    let mut found: Vec<Branch> = Vec::new();
    for Route { guide, turn } in routes(&scenario.start, reach) {
        let end = guide.at(guide.length());
        let known = found
            .iter()
            .any(|other| (other.guide.at(other.guide.length()) - end).norm() <= SAME_END_DISTANCE);
        if !known && leaves(&guide, logged) {
            let path = drive(&scenario.start, &guide, curvature);
            found.push(Branch { path_entries: path_entries(scenario, &path), path, turn, guide });
        }
    }
    found
}

/// Returns the routes over the lane graph of `reach` metres from the AV's lane and those beside it, those
/// from its own lane first.
pub(super) fn routes(start: &Start, reach: f64) -> Vec<Route> {
    let road = start.road_at(0);
    let now = start.now(0);
    let axle = now.position() - direction(now.heading) * (REAR_AXLE * start.agents[0].length);
    let mut found = Vec::new();
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(axle, ADJACENT_LANE.distance, &mut hits);
    let off =
        |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - now.heading).abs();
    let angle = |h: &LaneHit| {
        if h.projection.distance <= OWN_LANE.distance { OWN_LANE.angle } else { ADJACENT_LANE.angle }
    };
    hits.retain(|h| off(h) < angle(h) && road.lane(h.lane).class != LaneClass::Bike);
    // The AV's own lane comes first, so that routes reachable from it are not found from an adjacent
    // one.
    hits.sort_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
    let mut considered = 0;
    for hit in &hits {
        let mut open = vec![vec![hit.lane]];
        while let Some(chain) = open.pop() {
            let length: f64 = chain.iter().map(|&l| road.lane(l).baseline.length()).sum();
            let last = road.lane(chain[chain.len() - 1]);
            let on = last
                .successors
                .iter()
                .filter(|&&l| road.lane(l).class != LaneClass::Bike && !chain.contains(&l));
            let before = open.len();
            if length - hit.projection.s < reach {
                open.extend(on.map(|&l| chain.iter().copied().chain([l]).collect()));
            }
            if open.len() > before {
                continue;
            }
            considered += 1;
            if considered > MAX_ROUTES {
                return found;
            }
            let aside = hit.projection.distance > OWN_LANE.distance;
            let join = if aside { JOIN_DISTANCE.max(LANE_CHANGE_TIME * now.speed()) } else { JOIN_DISTANCE };
            if let Some((guide, turn)) = guide(&road, &chain, hit, axle, join, reach) {
                found.push(Route { guide, turn });
            }
        }
    }
    found
}

/// Returns the path that an AV drives along a guide line from its current pose.
pub(super) fn drive(start: &Start, guide: &Polyline, curvature: f64) -> AxlePath {
    let now = start.now(0);
    let from = Departure {
        pose: Pose::from(now),
        rear: REAR_AXLE * start.agents[0].length,
        reverse: false,
        curvature: Some(curvature),
        steering_speed: CALM_STEERING_RATE,
    };
    let bends = bend_speeds(guide);
    let pace = now.speed().clamp(5.0, 12.0);
    // An AV that sets off is slow at first, and steers while it accelerates.
    let setting_off =
        |s: f64| (now.speed() * now.speed() + 2.0 * START_ACCELERATION * s).sqrt().max(MIN_STEERING_SPEED);
    let expected = |s: f64| bends[(s as usize).min(bends.len() - 1)].min(pace).min(setting_off(s));
    let mut path = AxlePath::trace(guide, &from, guide.length() + 10.0, expected);
    path.limit_lateral(MAX_LATERAL_ACCELERATION);
    // An AV that is faster than the speed limit of a lane ahead must slow down, but not at once.
    let limits = Limits::along(&start.road(), &path, 0.0);
    path.limit_speed(|s| limits.at(s));
    path.stop_at(guide.length());
    path
}

/// Returns the speed that the bends of a guide line allow, m/s, one per metre: that of the sharpest bend
/// within the next few metres.
fn bend_speeds(guide: &Polyline) -> Vec<f64> {
    let metres = guide.length().ceil() as usize + 1;
    let turn = |s: f64| {
        wrap(guide.heading_at(s + 0.5 * BEND_LENGTH) - guide.heading_at((s - 0.5 * BEND_LENGTH).max(0.0)))
            .abs()
    };
    let at = |i: usize| {
        (MAX_LATERAL_ACCELERATION * BEND_LENGTH / turn(i as f64).max(1e-6)).sqrt().max(MIN_BEND_SPEED)
    };
    let alone: Vec<f64> = (0..metres).map(at).collect();
    let ahead = |i: usize| {
        alone[i..(i + BEND_LENGTH as usize).min(metres)].iter().copied().fold(f64::INFINITY, f64::min)
    };
    (0..metres).map(ahead).collect()
}

/// Returns the entries of vehicles onto a path: the first time that each is closer to it than
/// [`ON_PATH_DISTANCE`] while moving.
pub(super) fn path_entries(scenario: &Scenario, path: &AxlePath) -> Vec<PathEntry> {
    let poses: Vec<(Vec2, f64)> =
        (0..path.poses()).step_by(10).map(|i| path.pose(i)).map(|(pose, s)| (pose.position, s)).collect();
    let bounds = Bounds::of(poses.iter().map(|p| p.0)).inflated(ON_PATH_DISTANCE);
    let agents = scenario.start.agents.iter().zip(&scenario.log_future.tracks).skip(1);
    let vehicles = agents.filter(|(agent, _)| agent.kind == AgentKind::Vehicle);
    let first = vehicles.filter_map(|(_, track)| {
        track.iter().enumerate().step_by(2).find_map(|(k, frame)| {
            let p = frame.filter(|s| s.speed() > MOVING_SPEED)?.position();
            let apart = |pose: &&(Vec2, f64)| (pose.0 - p).norm_squared();
            let near =
                bounds.contains(p).then(|| poses.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))))??;
            (apart(&near) < ON_PATH_DISTANCE * ON_PATH_DISTANCE)
                .then(|| PathEntry { s: near.1, time: (k + 1) as f64 * DT })
        })
    });
    first.filter(|m| m.s > MIN_ENTRY_DISTANCE).collect()
}

/// Returns the guide line along a chain of lanes from the rear axle's position, which joins the centre
/// line within `join` metres, and its total turn, radians.
fn guide(
    road: &Road<'_>,
    chain: &[usize],
    hit: &LaneHit,
    axle: Vec2,
    join: f64,
    reach: f64,
) -> Option<(Polyline, f64)> {
    let offset = hit.projection.offset;
    let (mut points, mut distance) = (vec![axle], 0.0);
    let mut s = hit.projection.s;
    let (mut last, mut turn) = (None, 0.0);
    for &lane in chain {
        let line = &road.lane(lane).baseline;
        while s < line.length() && distance < reach {
            (s, distance) = (s + 1.0, distance + 1.0);
            let at = s.min(line.length());
            let heading = line.heading_at(at);
            turn += last.map_or(0.0, |l| wrap(heading - l));
            last = Some(heading);
            points.push(
                line.at(at) + left(direction(heading)) * (offset * (1.0 - smooth_step(distance / join))),
            );
        }
        s = (s - line.length()).max(0.0);
    }
    Some((Polyline::new(&points).ok()?, turn))
}

/// Returns whether a route leaves the logged path in another direction: at some point it is away from it
/// and turned relative to it.
fn leaves(guide: &Polyline, logged: &Polyline) -> bool {
    let mut s = 0.0;
    while s < guide.length() {
        let p = guide.at(s);
        let near = logged.project(p);
        let beyond = near.t >= 1.0 && near.segment + 1 == logged.segments();
        let turned = wrap(guide.heading_at(s) - logged.heading(near.segment)).abs();
        if !beyond && near.distance > DIVERGENCE_DISTANCE && turned > DIVERGENCE_ANGLE {
            return true;
        }
        s += 2.0;
    }
    false
}

/// Returns the offsets of adjacent lanes in the direction of the logged path, metres, left positive: at
/// most one on either side.
pub(super) fn adjacent_lanes(road: &Road<'_>, logged: &Polyline) -> Vec<f64> {
    let mut found = Vec::new();
    for side in [1.0, -1.0] {
        let mut offsets: Vec<f64> = Vec::new();
        for s in [5.0, 15.0, 25.0, 35.0] {
            let (p, heading) = (logged.at(s), logged.heading_at(s));
            let normal = left(direction(heading));
            let mut hits = Vec::new();
            road.lanes_near(p + normal * (3.5 * side), 1.2, &mut hits);
            let same = |h: &&LaneHit| {
                let lane = road.lane(h.lane);
                lane.class != LaneClass::Bike
                    && wrap(lane.baseline.heading(h.projection.segment) - heading).abs() < 0.4
            };
            let nearest = hits
                .iter()
                .filter(same)
                .min_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
            if let Some(hit) = nearest {
                // The offset of the lane from the path, not of the probe from the lane.
                let at = road.lane(hit.lane).baseline.at(hit.projection.s);
                offsets.push((at - p).dot(&normal));
            }
        }
        if offsets.len() >= 2 {
            offsets.sort_by(f64::total_cmp);
            found.push(offsets[offsets.len() / 2]);
        }
    }
    found
}

/// Returns the logged lane change: offsets of the logged path from the AV's current lane, extended over
/// its successors, metres, one per metre of path. `None` if the AV keeps to that lane, or turns off.
pub(super) fn merge(scenario: &Scenario, logged: &Polyline) -> Option<Vec<f64>> {
    let road = scenario.start.road();
    let now = scenario.start.now(0);
    let own = lane_along(&road, now.position(), now.heading, OWN_LANE)?;
    let mut points = road.lane(own.lane).baseline.points().to_vec();
    let (mut lane, mut length) = (own.lane, road.lane(own.lane).baseline.length() - own.projection.s);
    while length < logged.length() {
        let last = points[points.len() - 1];
        let end = road.lane(lane).baseline.heading(road.lane(lane).baseline.segments() - 1);
        let turn = |&l: &usize| wrap(road.lane(l).baseline.heading_at(20.0) - end).abs();
        let next = road.lane(lane).successors.iter().copied();
        let Some(next) = next.min_by(|a, b| turn(a).total_cmp(&turn(b))) else { break };
        let line = &road.lane(next).baseline;
        points.extend(line.points().iter().filter(|p| (*p - last).norm() > 1e-6));
        (lane, length) = (next, length + line.length());
        if points.len() > MAX_LANE_POINTS {
            break;
        }
    }
    let line = Polyline::new(&points).ok()?;
    let (mut offsets, mut s) = (Vec::new(), 0.0);
    while s < logged.length().min(length) {
        let near = line.project(logged.at(s));
        if wrap(logged.heading_at(s) - line.heading(near.segment)).abs() > OWN_LANE.angle {
            break;
        }
        offsets.push(near.offset);
        s += 1.0;
    }
    let (first, last) = (*offsets.first()?, *offsets.last()?);
    ((last - first).abs() > MIN_LANE_CHANGE).then_some(offsets)
}
