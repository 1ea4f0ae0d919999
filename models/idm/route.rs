//! Routes over the lane graph, chosen by position, motion and a random stream, never by the future.

use rand::RngExt;
use reactsim_geometry::{Polyline, Vec2, direction, math, wrap};
use reactsim_rollout::Stream;
use reactsim_scene::dynamics::Pose;
use reactsim_scene::{LaneClass, LaneHit, Road};

/// Present motion of a vehicle, from which a route is chosen.
#[derive(Clone, Copy, Debug)]
pub(super) struct Motion {
    pub(super) pose: Pose,
    /// Speed, m/s.
    pub(super) speed: f64,
    /// Curvature, 1/m.
    pub(super) curvature: f64,
}

/// A sequence of lanes, entered at arc length `s0` of the first one.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Route {
    pub(super) lanes: Vec<usize>,
    pub(super) s0: f64,
}

/// Largest distance at which a moving vehicle follows a lane, metres.
const MAX_DISTANCE: f64 = 3.2;
/// Largest angle to a lane that a vehicle follows, rad.
const MAX_ANGLE: f64 = 1.0;
/// Smallest distance ahead within which the motion decides between branches, metres.
const MIN_BRANCH_DISTANCE: f64 = 12.0;
/// Time ahead within which the motion decides between branches, seconds.
const BRANCH_TIME: f64 = 2.0;
/// Largest number of alternatives.
const MAX_ALTERNATIVES: usize = 48;
/// Cost difference at which an alternative is e times less likely.
const TEMPERATURE: f64 = 0.35;
/// Turning angle at which a branch is e times less likely when the motion does not decide, rad.
const TURN_SCALE: f64 = 0.35;
/// Additional lateral offset after 30 m at which a branch is e times less likely, metres.
const OFFSET_SCALE: f64 = 1.5;
/// Smallest weight of a branch, however sharply it turns.
const MIN_WEIGHT: f64 = 1e-6;
/// Distance beyond its beginning at which the direction of a branch is measured, metres.
const BRANCH_SAMPLE_DISTANCE: f64 = 30.0;
/// Largest number of lanes of a route.
const MAX_LANES: usize = 64;

/// Returns whether vehicles (or cyclists) may drive on a lane.
fn usable(road: &Road<'_>, lane: usize, cyclist: bool) -> bool {
    cyclist || road.lane(lane).class != LaneClass::Bike
}

/// Returns the lane at or near a vehicle that suits its heading best, with the projection onto it.
pub(super) fn nearest_lane(road: &Road<'_>, p: Vec2, heading: f64, cyclist: bool) -> Option<LaneHit> {
    let mut hits = Vec::new();
    road.lanes_near(p, MAX_DISTANCE, &mut hits);
    let cost = |h: &LaneHit| {
        let angle = wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - heading).abs();
        (usable(road, h.lane, cyclist) && angle < MAX_ANGLE).then_some(h.projection.distance + 2.0 * angle)
    };
    let best = hits.iter().filter_map(|h| Some((cost(h)?, h))).min_by(|a, b| a.0.total_cmp(&b.0));
    best.map(|(_, h)| *h)
}

/// Returns all routes ahead of a vehicle, as far as its motion can distinguish them, with their costs:
/// the distance of the lanes from its positions at its present speed and curvature.
pub(super) fn alternatives(road: &Road<'_>, motion: &Motion, cyclist: bool) -> Vec<(f64, Route)> {
    let mut hits = Vec::new();
    road.lanes_near(motion.pose.position, MAX_DISTANCE, &mut hits);
    let reach = MIN_BRANCH_DISTANCE.max(motion.speed * BRANCH_TIME);
    let mut found = Vec::new();
    for hit in &hits {
        let lane = road.lane(hit.lane);
        let angle = wrap(lane.baseline.heading(hit.projection.segment) - motion.pose.heading);
        if !usable(road, hit.lane, cyclist) || angle.abs() > MAX_ANGLE {
            continue;
        }
        // A lane that the vehicle has left or not yet reached is found through its neighbour in the
        // sequence.
        let beyond = hit.projection.t >= 1.0 && hit.projection.segment + 1 == lane.baseline.segments();
        if beyond && !lane.successors.is_empty() {
            continue;
        }
        let mut open = vec![Route { lanes: vec![hit.lane], s0: hit.projection.s }];
        while let Some(route) = open.pop() {
            let ahead: f64 =
                route.lanes.iter().map(|&l| road.lane(l).baseline.length()).sum::<f64>() - route.s0;
            let last = road.lane(route.lanes[route.lanes.len() - 1]);
            let next =
                last.successors.iter().filter(|&&l| usable(road, l, cyclist) && !route.lanes.contains(&l));
            let mut ended = true;
            if ahead < reach {
                for &lane in next {
                    ended = false;
                    let mut longer = route.clone();
                    longer.lanes.push(lane);
                    open.push(longer);
                }
            }
            if ended {
                found.push((cost(road, &route, motion), route));
            }
            if found.len() >= MAX_ALTERNATIVES {
                return found;
            }
        }
    }
    found
}

/// Returns the mean over the next two seconds of the distance between the route and the extrapolated
/// position, plus a weighted angle there.
fn cost(road: &Road<'_>, route: &Route, motion: &Motion) -> f64 {
    let mut total = 0.0;
    let times = [0.0, 0.5, 1.0, 1.5];
    for t in times {
        // A turn does not last: the curvature counts for one second.
        let along = motion.speed * t;
        let turning = motion.speed * t.min(1.0);
        let heading = motion.pose.heading + motion.curvature * turning;
        let middle = motion.pose.heading + 0.5 * motion.curvature * turning;
        let p = motion.pose.position + direction(middle) * along;
        let (mut best, mut angle) = (f64::INFINITY, 0.0);
        let mut from = route.s0;
        let mut passed = 0.0;
        for &l in &route.lanes {
            let line = &road.lane(l).baseline;
            let (first, last) = (line.segment_at(from), line.segment_at(from + along + 12.0 - passed) + 1);
            let hit = line.project_between(p, first, last);
            if hit.distance < best {
                best = hit.distance;
                angle = wrap(line.heading(hit.segment) - heading).abs();
            }
            passed += line.length() - from;
            from = 0.0;
            if passed > along + 10.0 {
                break;
            }
        }
        total += best + 3.0 * angle;
    }
    total / times.len() as f64
}

/// Leaves only the alternatives along a route and beyond its end, if there are any.
pub(super) fn keep_to(route: &Route, alternatives: &mut Vec<(f64, Route)>) {
    let follows = |other: &Route| {
        let from = route.lanes.iter().position(|lane| other.lanes.first() == Some(lane));
        from.is_some_and(|from| route.lanes[from..].iter().zip(&other.lanes).all(|(a, b)| a == b))
    };
    if alternatives.iter().any(|(_, other)| follows(other)) {
        alternatives.retain(|(_, other)| follows(other));
    }
}

/// Draws one of the alternatives; the lower its cost, the likelier it is.
pub(super) fn choose(alternatives: Vec<(f64, Route)>, stream: &mut Stream) -> Option<Route> {
    let least = alternatives.iter().map(|a| a.0).fold(f64::INFINITY, f64::min);
    let weights = alternatives.iter().map(|a| math::exp(-(a.0 - least) / TEMPERATURE));
    let chosen = draw(&weights.collect::<Vec<f64>>(), stream)?;
    alternatives.into_iter().nth(chosen).map(|(_, route)| route)
}

/// Draws an index with a probability proportional to its weight; `None` if there are no weights. Draws
/// one number in any case.
fn draw(weights: &[f64], stream: &mut Stream) -> Option<usize> {
    let mut rest = stream.random::<f64>() * weights.iter().sum::<f64>();
    let reached = weights.iter().position(|weight| {
        rest -= weight;
        rest <= 0.0
    });
    // Rounding may leave a remainder of the sum after the last weight.
    reached.or(weights.len().checked_sub(1))
}

/// Extends a route until it is `length` metres long from its entry, straight on more often than around
/// a corner.
pub(super) fn extend(road: &Road<'_>, route: &mut Route, length: f64, cyclist: bool, stream: &mut Stream) {
    let mut ahead: f64 = route.lanes.iter().map(|&l| road.lane(l).baseline.length()).sum::<f64>() - route.s0;
    while ahead < length && route.lanes.len() < MAX_LANES {
        let last = road.lane(route.lanes[route.lanes.len() - 1]);
        let end = last.baseline.heading(last.baseline.segments() - 1);
        let next: Vec<usize> =
            last.successors.iter().copied().filter(|&l| usable(road, l, cyclist)).collect();
        // Turning angle and lateral offset of a branch well after its beginning: connectors and turn
        // pockets begin alike.
        let (origin, ahead_axis) = (last.baseline.at(last.baseline.length()), direction(end));
        let leads = |l: usize| {
            let line = &road.lane(l).baseline;
            let s = line.length().min(BRANCH_SAMPLE_DISTANCE);
            (wrap(line.heading_at(s) - end).abs(), ahead_axis.perp(&(line.at(s) - origin)))
        };
        let least = next.iter().map(|&l| leads(l).1.abs()).fold(f64::INFINITY, f64::min);
        let weight = |&l: &usize| {
            let (turn, aside) = leads(l);
            math::exp(-turn / TURN_SCALE - (aside.abs() - least) / OFFSET_SCALE) + MIN_WEIGHT
        };
        let weights: Vec<f64> = next.iter().map(weight).collect();
        let Some(lane) = draw(&weights, stream).map(|k| next[k]) else { return };
        route.lanes.push(lane);
        ahead += road.lane(lane).baseline.length();
    }
}

/// Returns the centre line of a route from a little behind its entry, and the arc length at which each
/// lane begins on it.
pub(super) fn center_line(
    road: &Road<'_>,
    route: &Route,
    length: f64,
) -> Option<(Polyline, Vec<(f64, usize)>)> {
    let mut points: Vec<Vec2> = Vec::new();
    let mut starts = Vec::new();
    let behind = (route.s0 - 4.0).max(0.0);
    let mut s = 0.0;
    for (k, &l) in route.lanes.iter().enumerate() {
        let line = &road.lane(l).baseline;
        let from = if k == 0 { behind } else { 0.0 };
        starts.push((s - from, l));
        if k == 0 {
            points.push(line.at(behind));
        }
        // Recorded points are half a metre apart; a metre is enough for steering.
        let mut last = f64::NEG_INFINITY;
        for (i, (&p, &arc)) in line.points().iter().zip(line.arc()).enumerate() {
            let end = i + 1 == line.points().len();
            if arc > from && (arc - last > 0.9 || end) {
                points.push(p);
                last = arc;
            }
        }
        s += line.length() - from;
        if s > length + 10.0 {
            break;
        }
    }
    Some((Polyline::new(&points).ok()?, starts))
}
