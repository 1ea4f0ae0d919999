//! The category of a deviation, determined from the trajectories and the lane graph (ReactSim-Bench,
//! "Deviation Taxonomy"; metrics' definition 10.3). The source of a candidate does not matter.

use std::f64::consts::{FRAC_PI_2, PI};

use reactsim_geometry::{OrientedBox, Polyline, Projection, Vec2, direction, wrap};
use reactsim_scene::{Agent, AgentState, Deviation, LaneHit, Road};

use super::Taxonomy;

/// Heading difference to the logged path beyond which the direction is another one, degrees.
const DIRECTIONAL_ANGLE: f64 = 30.0;
/// Lateral distance from the logged path beyond which the AV is next to it, metres.
const LATERAL_OFFSET: f64 = 1.0;
/// Largest heading difference at which the AV is still on the logged path at the conflict, degrees.
const ALONG_ANGLE: f64 = 15.0;
/// Distance along the logged path from the logged position beyond which the AV is elsewhere, metres.
const LONGITUDINAL_OFFSET: f64 = 1.0;
/// Number of steps after the conflict within which a change of direction still counts as its cause.
const TURN_DELAY_STEPS: usize = 20;
/// Distance beyond which two successors of a lane have diverged, metres.
const DIVERGENCE_DISTANCE: f64 = 2.5;
/// Heading difference beyond which two successors of a lane have diverged, radians.
const DIVERGENCE_ANGLE: f64 = 0.17;
/// Largest distance from the centre line of a lane at which a state is on it, metres.
const ON_LANE_DISTANCE: f64 = 1.2;
/// Largest angle to a lane at which a state is on it, radians.
const ON_LANE_ANGLE: f64 = 0.3;

/// The first conflict under log replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conflict {
    /// Step, from 1.
    pub step: usize,
    /// Box of the vehicle that the AV touches at this step; `None` if it only comes close.
    pub touched: Option<OrientedBox>,
}

/// Determines the category of a trajectory of the AV `av`.
///
/// `path` is the logged path of the box centre, extended beyond the end of the log; `log` and `track`
/// have as many states; `conflict` is the first one under log replay.
///
/// Headings and offsets are relative to the nearest point of the logged path, so that an AV that stops
/// in the middle of the logged turn has not taken another direction. If there are several cues, the one
/// that explains the conflict decides: longitudinal, if the AV would be hit on the logged path as well;
/// directional, if the AV has turned by then or soon after; else lateral.
pub fn classify(
    road: &Road<'_>,
    path: &Polyline,
    log: &[AgentState],
    track: &[AgentState],
    av: &Agent,
    conflict: Option<Conflict>,
) -> Taxonomy {
    // The heading of a reversing vehicle is opposite to its path.
    let flip = match track.first() {
        Some(s) if wrap(s.heading - path.heading(0)).abs() > FRAC_PI_2 => PI,
        _ => 0.0,
    };
    let places: Vec<PathPosition> = track.iter().map(|s| PathPosition::of(path, s, flip)).collect();
    let along = |k: usize| places[k].s - PathPosition::of(path, &log[k], flip).s;
    let largest = |values: &mut dyn Iterator<Item = f64>| {
        values.fold(0.0_f64, |a, v| if v.abs() > a.abs() { v } else { a })
    };
    let lateral_offset = largest(&mut places.iter().map(|p| p.offset));
    let longitudinal_offset = largest(&mut (0..track.len()).map(along));
    let heading_change = places.last().map_or(0.0, |p| p.turned);
    let lateral = lateral_offset.abs() > LATERAL_OFFSET;
    let forked = if lateral { fork(road, &chain(road, log), &chain(road, track), track) } else { None };
    // First step from which the heading stays turned to the end.
    let straight = places.iter().rposition(|p| p.turned <= DIRECTIONAL_ANGLE).map_or(0, |k| k + 1);
    let turned = (heading_change > DIRECTIONAL_ANGLE).then_some(straight);
    let directed = [forked, turned].into_iter().flatten().min();
    let category = match (conflict, directed) {
        (Some(c), _) if is_on_logged_path(&places[c.step], along(c.step), path, av, &c) => {
            Deviation::Longitudinal
        }
        (_, None) if !lateral => Deviation::Longitudinal,
        (Some(c), Some(k))
            if places[c.step].offset.abs() > LATERAL_OFFSET && k > c.step + TURN_DELAY_STEPS =>
        {
            Deviation::Lateral
        }
        (_, Some(_)) => Deviation::Directional,
        (_, None) => Deviation::Lateral,
    };
    Taxonomy {
        category,
        heading_change,
        other_branch: forked.is_some(),
        lateral_offset,
        longitudinal_offset,
        conflict_step: conflict.map(|c| c.step as u32),
    }
}

/// Returns whether the conflict would occur on the logged path as well, at another time than in the log.
fn is_on_logged_path(
    place: &PathPosition,
    along: f64,
    path: &Polyline,
    av: &Agent,
    conflict: &Conflict,
) -> bool {
    if place.offset.abs() > LATERAL_OFFSET || place.turned > ALONG_ANGLE || along.abs() <= LONGITUDINAL_OFFSET
    {
        return false;
    }
    conflict.touched.is_none_or(|other| {
        let own = OrientedBox::new(path.at(place.s), path.heading_at(place.s), av.length, av.width);
        other.separation(&own) <= 0.0
    })
}

/// Position of a state relative to the logged path.
struct PathPosition {
    /// Arc length along the path, metres, also beyond its end.
    s: f64,
    /// Lateral offset, metres, left positive.
    offset: f64,
    /// Heading difference to the path, degrees, 0 to 180.
    turned: f64,
}

impl PathPosition {
    fn of(path: &Polyline, state: &AgentState, flip: f64) -> Self {
        let p = state.position();
        let near = path.project(p);
        let heading = path.heading(near.segment);
        let (s, offset) = beyond(path, &near, p).unwrap_or((near.s, near.offset));
        Self { s, offset, turned: wrap(state.heading - heading - flip).abs().to_degrees() }
    }
}

/// Returns arc length and offset of a point beyond the end of a polyline, which is extended straight
/// there.
fn beyond(path: &Polyline, near: &Projection, p: Vec2) -> Option<(f64, f64)> {
    let last = near.segment + 1 == path.segments() && near.t >= 1.0;
    let d = p - path.points()[path.segments()];
    let ahead = direction(path.heading(near.segment));
    last.then(|| (near.s + d.dot(&ahead).max(0.0), ahead.perp(&d)))
}

/// Returns the lanes that a track follows, in order.
fn chain(road: &Road<'_>, track: &[AgentState]) -> Vec<usize> {
    let mut chain: Vec<usize> = Vec::new();
    let mut hits: Vec<LaneHit> = Vec::new();
    let mut last: Option<Vec2> = None;
    for state in track {
        let p = state.position();
        if last.is_some_and(|l| (p - l).norm() < 1.0) {
            continue;
        }
        last = Some(p);
        road.lanes_at(p, &mut hits);
        let off = |h: &LaneHit| {
            wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - state.heading).abs()
        };
        hits.retain(|h| off(h) < 0.7);
        let cost = |h: &LaneHit| off(h) * 4.0 + h.projection.distance;
        let best = hits.iter().min_by(|a, b| cost(a).total_cmp(&cost(b)));
        if let Some(hit) = best
            && chain.last() != Some(&hit.lane)
        {
            chain.push(hit.lane);
        }
    }
    chain
}

/// Returns the first step at which a track is on a different successor of a lane than the log, after the
/// two have diverged.
fn fork(road: &Road<'_>, log: &[usize], own: &[usize], track: &[AgentState]) -> Option<usize> {
    let siblings = |b: usize| {
        let forks = road.lane(b).predecessors.iter();
        forks.flat_map(|&fork| &road.lane(fork).successors).copied().filter(move |&a| a != b)
    };
    let diverged = |a: usize, b: usize, state: &AgentState| {
        let p = state.position();
        let (a, b) = (&road.lane(a).baseline, &road.lane(b).baseline);
        let (from_a, from_b) = (a.project(p), b.project(p));
        let (along_a, along_b) = (a.heading(from_a.segment), b.heading(from_b.segment));
        let ends = |line: &Polyline| line.heading(line.segments() - 1);
        // A lane that opens next to another one and runs parallel to it is not another direction.
        wrap(ends(b) - ends(a)).abs() > DIVERGENCE_ANGLE
            && from_b.distance < ON_LANE_DISTANCE
            && from_a.distance > DIVERGENCE_DISTANCE
            && wrap(along_b - along_a).abs() > DIVERGENCE_ANGLE
            && wrap(along_b - state.heading).abs() < ON_LANE_ANGLE
    };
    let others = own.iter().filter(|b| !log.contains(b));
    let pairs = others.flat_map(|&b| siblings(b).filter(|a| log.contains(a)).map(move |a| (a, b)));
    pairs.filter_map(|(a, b)| track.iter().position(|s| diverged(a, b, s))).min()
}
