//! Checks of adjacent lanes: neighbours, and overlaps of lanes that are not connectors.

use reactsim_geometry::{Vec2, ring_distance};
use reactsim_scene::NeighborParts;

use super::survey::{Survey, TracedLane};
use super::{Flaws, Rule};

/// Maximum overlap of lanes, metres, since their borders are sampled.
const OVERLAP_TOLERANCE: f64 = 0.1;
/// Additional distance from the ends of linked lanes, metres, within which they may overlap.
const LINK_TOLERANCE: f64 = 0.5;
/// Distance between tested border points, metres.
const POINT_SPACING: f64 = 3.0;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    for lane in &survey.lanes {
        for (beside, on_left) in [(&lane.part.left, true), (&lane.part.right, false)] {
            for n in beside {
                if let Err((place, found)) = neighbour(survey, lane, n, on_left) {
                    flaws.add(Rule::Neighbour, lane.id(), place, format!("`{}`: {found}", n.lane));
                }
            }
        }
    }
    for (i, a) in survey.lanes.iter().enumerate().filter(|(_, l)| !l.is_connector()) {
        for b in survey.lanes[i + 1..].iter().filter(|l| !l.is_connector()) {
            if !a.bounds.intersects(&b.bounds) {
                continue;
            }
            if let Some(at) = overlap(a, b).or_else(|| overlap(b, a)) {
                flaws.add(Rule::Overlap, a.id(), at, format!("overlaps lane `{}`", b.id()));
            }
        }
    }
}

fn neighbour(
    survey: &Survey<'_>,
    lane: &TracedLane<'_>,
    n: &NeighborParts,
    on_left: bool,
) -> Result<(), (Vec2, String)> {
    let error = |place: Vec2, found: String| Err((place, found));
    let other = survey.lane(&n.lane);
    let (own, its) = (lane.line.points(), other.line.points());
    let (from, to) = (n.self_start as usize, n.self_end as usize);
    let (its_from, its_to) = (n.other_start as usize, n.other_end as usize);
    if !(from < to && to < own.len() && its_from < its_to && its_to < its.len()) {
        return error(
            lane.start(),
            format!("points {from} to {to} and {its_from} to {its_to} are no stretch"),
        );
    }
    let back = if on_left { &other.part.right } else { &other.part.left };
    let mutual = NeighborParts {
        lane: lane.part.id.clone(),
        self_start: n.other_start,
        self_end: n.other_end,
        other_start: n.self_start,
        other_end: n.self_end,
    };
    if !back.contains(&mutual) {
        return error(own[from], "does not name this lane on the other side with the same stretch".into());
    }
    let step = ((to - from) / 8).max(1);
    for i in (from..=to).step_by(step) {
        let hit = other.line.project_between(own[i], its_from, its_to);
        let segment = i.min(lane.line.segments() - 1);
        let across = other.line.on_segment(hit.s, hit.segment) - own[i];
        if lane.unit(segment).dot(&other.unit(hit.segment)) < 0.9 {
            return error(own[i], "has another direction".into());
        }
        if (lane.unit(segment).perp(&across) > 0.0) != on_left {
            return error(own[i], "is on the other side".into());
        }
        // Half of each width, measured on the outlines away from the ends.
        let on = other.line.on_segment(hit.s, hit.segment);
        let clear = |l: &TracedLane<'_>, p: Vec2| {
            (l.start() - p).norm().min((l.end() - p).norm()) > 0.75 * hit.distance
        };
        if i > from && i + step < to && clear(lane, own[i]) && clear(other, on) {
            let width = ring_distance(own[i], &lane.ring) + ring_distance(on, &other.ring);
            if !(hit.distance > 0.75 * width && hit.distance < 1.3 * width + 0.3) {
                return error(own[i], format!("is {:.2} m away, expected about {width:.2} m", hit.distance));
            }
        }
    }
    Ok(())
}

/// Returns a point of the outline or the centre line of `a` that is inside `b`, away from where they are
/// linked.
fn overlap(a: &TracedLane<'_>, b: &TracedLane<'_>) -> Option<Vec2> {
    let linked = |p: Vec2| {
        let touch = |x: &TracedLane<'_>, y: &TracedLane<'_>| {
            x.part.successors.contains(&y.part.id) && (x.end() - p).norm() < half_width(x) + LINK_TOLERANCE
        };
        touch(a, b) || touch(b, a)
    };
    let inside = |p: &Vec2| {
        b.bounds.contains(*p) && b.holds(*p, OVERLAP_TOLERANCE) && !linked(*p) && !a.is_apart(b, *p)
    };
    let corners = a.ring.iter().zip(a.ring.iter().skip(1).chain(a.ring.first()));
    let border = corners.flat_map(|(&p, &q)| {
        let count = ((q - p).norm() / POINT_SPACING).ceil().max(1.0);
        (0..count as usize).map(move |k| p + (q - p) * (k as f64 / count))
    });
    a.line.points().iter().copied().chain(border).find(inside)
}

/// Returns half of the width of a lane at its end, metres.
fn half_width(lane: &TracedLane<'_>) -> f64 {
    let near = lane.line.at((lane.line.length() - 4.0).max(0.5 * lane.line.length()));
    ring_distance(near, &lane.ring)
}
