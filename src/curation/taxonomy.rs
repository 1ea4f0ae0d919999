//! The category of a deviation, read from the trajectories and the lane graph (ReactSim-Bench, "Deviation Taxonomy"; metrics' definition
//! 10.3). Which source made a candidate does not matter.

use std::f64::consts::{FRAC_PI_2, PI};

use super::Taxonomy;
use crate::geometry::{OrientedBox, Polyline, Projection, Vec2, direction, wrap};
use crate::scene::{Agent, AgentState, Deviation, LaneHit, Road};

/// Another direction: heading against the logged way, degrees.
const DIRECTIONAL: f64 = 30.0;
/// Beside the logged way, metres.
const LATERAL: f64 = 1.0;
/// Still on the logged way at the conflict: no more turned than this, degrees.
const ALONG: f64 = 15.0;
/// Somewhere else along the logged way than in the log, metres.
const LONGITUDINAL: f64 = 1.0;
/// Another direction that is taken within so many steps of the conflict is on its way there.
const SOON: usize = 20;
/// Two successors of a lane have parted where they are so many metres and radians apart.
const PARTED: (f64, f64) = (2.5, 0.17);
/// On a lane up to this distance from its centre line, metres.
const ON_LANE: f64 = 1.2;
/// And up to this angle to it, radians.
const ON_COURSE: f64 = 0.3;

/// The first conflict under log replay.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Conflict {
    /// Step, 1 to 80.
    pub step: usize,
    /// The box of the vehicle that the AV touches there; `None` where it only comes close.
    pub touched: Option<OrientedBox>,
}

/// Reads the category of a trajectory of the AV `av`. `way`: the logged way of the box centre, gone on with beyond the log's end; `log`
/// and `track`: 81 states each; `conflict`: the first one under log replay.
///
/// Headings and offsets are taken against the nearest point of the logged way, so that an AV that stops in the middle of the logged turn
/// has not taken another direction. Where several cues are there, the one that explains the conflict decides: another speed, if the
/// AV would be met on the logged way as well; another direction, if it is taken by then or soon after; else another lateral position.
pub fn classify(
    road: &Road<'_>,
    way: &Polyline,
    log: &[AgentState],
    track: &[AgentState],
    av: &Agent,
    conflict: Option<Conflict>,
) -> Taxonomy {
    // A vehicle that reverses points against its way.
    let flip = match track.first() {
        Some(s) if wrap(s.heading - way.heading(0)).abs() > FRAC_PI_2 => PI,
        _ => 0.0,
    };
    let places: Vec<Place> = track.iter().map(|s| Place::of(way, s, flip)).collect();
    let along = |k: usize| places[k].s - Place::of(way, &log[k], flip).s;
    let largest = |values: &mut dyn Iterator<Item = f64>| {
        values.fold(0.0_f64, |a, v| if v.abs() > a.abs() { v } else { a })
    };
    let lateral_offset = largest(&mut places.iter().map(|p| p.offset));
    let longitudinal_offset = largest(&mut (0..track.len()).map(along));
    let heading_change = places.last().map_or(0.0, |p| p.turned);
    let lateral = lateral_offset.abs() > LATERAL;
    let forked = if lateral { fork(road, &chain(road, log), &chain(road, track), track) } else { None };
    // Turned for good, that is.
    let straight = places.iter().rposition(|p| p.turned <= DIRECTIONAL).map_or(0, |k| k + 1);
    let turned = (heading_change > DIRECTIONAL).then_some(straight);
    let directed = [forked, turned].into_iter().flatten().min();
    let category = match (conflict, directed) {
        (Some(c), _) if on_the_way(&places[c.step], along(c.step), way, av, &c) => Deviation::Longitudinal,
        (_, None) if !lateral => Deviation::Longitudinal,
        (Some(c), Some(k)) if places[c.step].offset.abs() > LATERAL && k > c.step + SOON => {
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

/// Whether the AV is met where it would be met on the logged way as well, at another time than in the log.
fn on_the_way(place: &Place, along: f64, way: &Polyline, av: &Agent, conflict: &Conflict) -> bool {
    if place.offset.abs() > LATERAL || place.turned > ALONG || along.abs() <= LONGITUDINAL {
        return false;
    }
    conflict.touched.is_none_or(|other| {
        let own = OrientedBox::new(way.at(place.s), way.heading_at(place.s), av.length, av.width);
        other.separation(&own) <= 0.0
    })
}

/// Where a state lies against the logged way.
struct Place {
    /// Way along it, metres, also beyond its end.
    s: f64,
    /// Metres, left positive.
    offset: f64,
    /// Degrees, 0 to 180.
    turned: f64,
}

impl Place {
    fn of(way: &Polyline, state: &AgentState, flip: f64) -> Self {
        let p = state.position();
        let near = way.project(p);
        let heading = way.heading(near.segment);
        let (s, offset) = beyond(way, &near, p).unwrap_or((near.s, near.offset));
        Self { s, offset, turned: wrap(state.heading - heading - flip).abs().to_degrees() }
    }
}

/// Way and offset of a point beyond the end of a polyline, which goes on straight there.
fn beyond(way: &Polyline, near: &Projection, p: Vec2) -> Option<(f64, f64)> {
    let last = near.segment + 1 == way.segments() && near.t >= 1.0;
    let d = p - way.points()[way.segments()];
    let ahead = direction(way.heading(near.segment));
    last.then(|| (near.s + d.dot(&ahead).max(0.0), ahead.perp(&d)))
}

/// The lanes that a track follows, one after the other.
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

/// The first step at which a track is on another successor of a lane than the log, where the two have parted.
fn fork(road: &Road<'_>, log: &[usize], own: &[usize], track: &[AgentState]) -> Option<usize> {
    let siblings = |b: usize| {
        let forks = road.lane(b).predecessors.iter();
        forks.flat_map(|&fork| &road.lane(fork).successors).copied().filter(move |&a| a != b)
    };
    let parted = |a: usize, b: usize, state: &AgentState| {
        let p = state.position();
        let (a, b) = (&road.lane(a).baseline, &road.lane(b).baseline);
        let (from_a, from_b) = (a.project(p), b.project(p));
        let (along_a, along_b) = (a.heading(from_a.segment), b.heading(from_b.segment));
        let ends = |line: &Polyline| line.heading(line.segments() - 1);
        // A lane that opens beside another one and goes on with it is no other direction.
        wrap(ends(b) - ends(a)).abs() > PARTED.1
            && from_b.distance < ON_LANE
            && from_a.distance > PARTED.0
            && wrap(along_b - along_a).abs() > PARTED.1
            && wrap(along_b - state.heading).abs() < ON_COURSE
    };
    let others = own.iter().filter(|b| !log.contains(b));
    let pairs = others.flat_map(|&b| siblings(b).filter(|a| log.contains(a)).map(move |a| (a, b)));
    pairs.filter_map(|(a, b)| track.iter().position(|s| parted(a, b, s))).min()
}
