//! Other ways over the lane graph than the logged one.

use super::survey::{LATERAL, Limits};
use crate::dynamics::{AxlePath, CALM_STEERING, Departure, Pose, REAR_AXLE};
use crate::geometry::{Bounds, Polyline, Vec2, direction, left, smooth_step, wrap};
use crate::scene::{AgentKind, DT, LaneClass, LaneHit, Road, Scenario};

/// A lane counts as the AV's own up to this distance (metres) and angle (radians).
const OWN_LANE: (f64, f64) = (2.2, 0.6);
/// A lane beside it, from which the AV may turn off, too.
const NEXT_LANE: (f64, f64) = (4.5, 0.3);
/// Way within which the AV leads onto the centre line of its lane, metres; to the next lane it takes that time, s, if that is farther.
const JOIN: f64 = 20.0;
const CHANGE: f64 = 2.5;
/// Ways that are looked at.
const MOST: usize = 48;
/// Two ways leave one another where they are this far apart, metres.
const APART: f64 = 2.5;
/// Angle between them, there or at the end, radians.
const TURNED: f64 = 0.26;
/// Length over which a bend is measured, and within which it is foreseen, metres.
const BEND: f64 = 6.0;
/// Acceleration of one who sets off, m/s², and the least speed that is steered for, m/s.
const SET_OFF: f64 = 1.5;
const CREEP: f64 = 1.5;
/// No bend is taken slower, m/s.
const SLOWEST: f64 = 2.5;
/// Another lane is at least so far aside, metres.
const CHANGED: f64 = 2.5;
/// No lane that is followed has more points.
const MOST_POINTS: usize = 4000;
/// Somebody is on a way who is closer to it than this, metres.
const CLOSE: f64 = 2.5;
/// Who is slower stands, m/s.
const MOVES: f64 = 1.0;
/// Meetings closer than this are the AV's present neighbours, metres.
const AHEAD: f64 = 5.0;
/// Two ways whose ends are closer than this are one, metres.
const SAME_END: f64 = 4.0;

/// Another way.
pub(super) struct Branch {
    /// The way of the rear axle.
    guide: Polyline,
    /// The way as the AV drives it; it ends where the lanes do.
    pub(super) path: AxlePath,
    /// How much it turns, radians, left positive.
    turn: f64,
    /// Where and when others come onto it under log replay.
    pub(super) meetings: Vec<Meeting>,
}

/// Somebody comes onto a way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Meeting {
    /// How far along the way, metres.
    pub(super) s: f64,
    /// When, seconds from now.
    pub(super) time: f64,
}

impl Branch {
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

/// The ways from the AV's lane that leave the logged way (`logged`: of the box centre) within `reach` metres, for an AV whose rear axle's
/// path has that curvature now (1/m).
pub(super) fn branches(scenario: &Scenario, logged: &Polyline, curvature: f64, reach: f64) -> Vec<Branch> {
    let road = scenario.start.road();
    let now = scenario.start.now(0);
    let axle = now.position() - direction(now.heading) * (REAR_AXLE * scenario.start.agents[0].length);
    let mut found: Vec<Branch> = Vec::new();
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(axle, NEXT_LANE.0, &mut hits);
    let off =
        |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - now.heading).abs();
    let angle = |h: &LaneHit| if h.projection.distance <= OWN_LANE.0 { OWN_LANE.1 } else { NEXT_LANE.1 };
    hits.retain(|h| off(h) < angle(h) && road.lane(h.lane).class != LaneClass::Bike);
    // The AV's own lane first: what can be reached from it is not reached from another one.
    hits.sort_by(|a, b| a.projection.distance.total_cmp(&b.projection.distance));
    let mut looked = 0;
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
            looked += 1;
            if looked > MOST {
                return found;
            }
            let aside = hit.projection.distance > OWN_LANE.0;
            let join = if aside { JOIN.max(CHANGE * now.speed()) } else { JOIN };
            let Some((guide, turn)) = guide(&road, &chain, hit, axle, join, reach) else { continue };
            let end = guide.at(guide.length());
            let known =
                found.iter().any(|other| (other.guide.at(other.guide.length()) - end).norm() <= SAME_END);
            if !known && leaves(&guide, logged) {
                let path = drive(scenario, &guide, curvature);
                found.push(Branch { meetings: meetings(scenario, &path), path, turn, guide });
            }
        }
    }
    found
}

/// The lane that suits a pose best, of those within a distance (metres) and an angle (radians).
pub(super) fn lane_along(
    road: &Road<'_>,
    p: Vec2,
    heading: f64,
    (reach, angle): (f64, f64),
) -> Option<LaneHit> {
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(p, reach, &mut hits);
    let off = |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
    let cost = |h: &LaneHit| h.projection.distance + 2.0 * off(h);
    let along = hits.into_iter().filter(|h| off(h) < angle);
    along.min_by(|a, b| cost(a).total_cmp(&cost(b)))
}

/// The way that an AV drives along a guide, from where it is.
fn drive(scenario: &Scenario, guide: &Polyline, curvature: f64) -> AxlePath {
    let now = scenario.start.now(0);
    let from = Departure {
        pose: Pose::from(now),
        rear: REAR_AXLE * scenario.start.agents[0].length,
        reverse: false,
        curvature: Some(curvature),
        steering_speed: CALM_STEERING,
    };
    let bends = bend_speeds(guide);
    let pace = now.speed().clamp(5.0, 12.0);
    // Who sets off is slow at first, and turns the wheel on the way.
    let setting_off = |s: f64| (now.speed() * now.speed() + 2.0 * SET_OFF * s).sqrt().max(CREEP);
    let expected = |s: f64| bends[(s as usize).min(bends.len() - 1)].min(pace).min(setting_off(s));
    let mut path = AxlePath::trace(guide, &from, guide.length() + 10.0, expected);
    path.limit_lateral(LATERAL);
    // Who is faster now than a lane ahead allows has to slow down, but not at once.
    let limits = Limits::along(&scenario.start.road(), &path, 0.0);
    path.limit_speed(|s| limits.at(s));
    path.stop_at(guide.length());
    path
}

/// The speed that the bends of a way allow, m/s, one per metre: that of the sharpest within the next few metres.
fn bend_speeds(guide: &Polyline) -> Vec<f64> {
    let metres = guide.length().ceil() as usize + 1;
    let turn =
        |s: f64| wrap(guide.heading_at(s + 0.5 * BEND) - guide.heading_at((s - 0.5 * BEND).max(0.0))).abs();
    let at = |i: usize| (LATERAL * BEND / turn(i as f64).max(1e-6)).sqrt().max(SLOWEST);
    let alone: Vec<f64> = (0..metres).map(at).collect();
    let ahead =
        |i: usize| alone[i..(i + BEND as usize).min(metres)].iter().copied().fold(f64::INFINITY, f64::min);
    (0..metres).map(ahead).collect()
}

/// Where and when vehicles come onto a way: the first time that each is closer to it than `CLOSE`, while it moves.
pub(super) fn meetings(scenario: &Scenario, path: &AxlePath) -> Vec<Meeting> {
    let poses: Vec<(Vec2, f64)> =
        (0..path.poses()).step_by(10).map(|i| path.pose(i)).map(|(pose, s)| (pose.position, s)).collect();
    let bounds = Bounds::of(poses.iter().map(|p| p.0)).inflated(CLOSE);
    let agents = scenario.start.agents.iter().zip(&scenario.log_future.tracks).skip(1);
    let vehicles = agents.filter(|(agent, _)| agent.kind == AgentKind::Vehicle);
    let first = vehicles.filter_map(|(_, track)| {
        track.iter().enumerate().step_by(2).find_map(|(k, frame)| {
            let p = frame.filter(|s| s.speed() > MOVES)?.position();
            let apart = |pose: &&(Vec2, f64)| (pose.0 - p).norm_squared();
            let near =
                bounds.contains(p).then(|| poses.iter().min_by(|a, b| apart(a).total_cmp(&apart(b))))??;
            (apart(&near) < CLOSE * CLOSE).then(|| Meeting { s: near.1, time: (k + 1) as f64 * DT })
        })
    });
    first.filter(|m| m.s > AHEAD).collect()
}

/// The way along a chain of lanes from where the rear axle is, leading onto the centre line within `join`
/// metres; and how much it turns, radians.
fn guide(
    road: &Road<'_>,
    chain: &[usize],
    hit: &LaneHit,
    axle: Vec2,
    join: f64,
    reach: f64,
) -> Option<(Polyline, f64)> {
    let offset = hit.projection.offset;
    let (mut points, mut way) = (vec![axle], 0.0);
    let mut s = hit.projection.s;
    let (mut last, mut turn) = (None, 0.0);
    for &lane in chain {
        let line = &road.lane(lane).baseline;
        while s < line.length() && way < reach {
            (s, way) = (s + 1.0, way + 1.0);
            let at = s.min(line.length());
            let heading = line.heading_at(at);
            turn += last.map_or(0.0, |l| wrap(heading - l));
            last = Some(heading);
            points.push(line.at(at) + left(direction(heading)) * (offset * (1.0 - smooth_step(way / join))));
        }
        s = (s - line.length()).max(0.0);
    }
    Some((Polyline::new(&points).ok()?, turn))
}

/// Whether a way leaves the logged one for another direction: somewhere it is aside of it and turned against it.
fn leaves(guide: &Polyline, logged: &Polyline) -> bool {
    let mut s = 0.0;
    while s < guide.length() {
        let p = guide.at(s);
        let near = logged.project(p);
        let beyond = near.t >= 1.0 && near.segment + 1 == logged.segments();
        let turned = wrap(guide.heading_at(s) - logged.heading(near.segment)).abs();
        if !beyond && near.distance > APART && turned > TURNED {
            return true;
        }
        s += 2.0;
    }
    false
}

/// Offsets of lanes beside the logged way that lead the same way, metres, left positive: at most one on either side.
pub(super) fn beside(road: &Road<'_>, logged: &Polyline) -> Vec<f64> {
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
                // The offset of the lane from the way, not of the probe from the lane.
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

/// The logged change of lanes: offsets of the logged way from the lane that the AV is on now, gone on with over its successors, metres,
/// one per metre of the way; `None` where it keeps to that lane, or turns off.
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
        if points.len() > MOST_POINTS {
            break;
        }
    }
    let line = Polyline::new(&points).ok()?;
    let (mut offsets, mut s) = (Vec::new(), 0.0);
    while s < logged.length().min(length) {
        let near = line.project(logged.at(s));
        if wrap(logged.heading_at(s) - line.heading(near.segment)).abs() > OWN_LANE.1 {
            break;
        }
        offsets.push(near.offset);
        s += 1.0;
    }
    let (first, last) = (*offsets.first()?, *offsets.last()?);
    ((last - first).abs() > CHANGED).then_some(offsets)
}
