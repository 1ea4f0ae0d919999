//! Checks of links, centre lines and outlines of lanes.

use super::crossing::first_crossing;
use super::survey::{Survey, TracedLane};
use super::{Flaws, Rule};

/// Maximum distance between the ends of linked lanes, metres.
const JOIN_TOLERANCE: f64 = 0.005;
/// Maximum difference in direction of linked lanes, as a chord of the unit circle (4 degrees).
const MAX_KINK: f64 = 0.0698;
/// Maximum curvature of a centre line, 1/m: a turning circle of 5 m, somewhat tighter than that of the
/// AASHTO passenger car.
const MAX_CURVATURE: f64 = 0.2;
/// Turn that a corner may have regardless of the distance between its points, rad, since lines are sampled.
const TURN_TOLERANCE: f64 = 0.01;

pub(super) fn check(survey: &Survey<'_>, flaws: &mut Flaws) {
    for lane in &survey.lanes {
        links(survey, lane, flaws);
        bends(lane, flaws);
        outline(lane, flaws);
    }
}

fn links(survey: &Survey<'_>, lane: &TracedLane<'_>, flaws: &mut Flaws) {
    for id in &lane.part.successors {
        let next = survey.lane(id);
        if !next.part.predecessors.contains(&lane.part.id) {
            flaws.add(Rule::Link, lane.id(), lane.end(), format!("successor `{id}` does not link back"));
        }
        let gap = (next.start() - lane.end()).norm();
        if !(gap <= JOIN_TOLERANCE) {
            let found = format!("successor `{id}` begins {gap:.3} m from its end, expected at most 0.005 m");
            flaws.add(Rule::Link, lane.id(), lane.end(), found);
        }
        let turn = (next.unit(0) - lane.unit(lane.line.segments() - 1)).norm();
        if !(turn < MAX_KINK) {
            let found =
                format!("turns by {:.1} degrees into `{id}`, expected less than 4", turn.to_degrees());
            flaws.add(Rule::Link, lane.id(), lane.end(), found);
        }
    }
    for id in &lane.part.predecessors {
        if !survey.lane(id).part.successors.contains(&lane.part.id) {
            flaws.add(Rule::Link, lane.id(), lane.start(), format!("predecessor `{id}` does not link to it"));
        }
    }
    let mut linked: Vec<&String> = lane.part.successors.iter().chain(&lane.part.predecessors).collect();
    linked.sort();
    if linked.windows(2).any(|w| w[0] == w[1]) || linked.contains(&&lane.part.id) {
        flaws.add(Rule::Link, lane.id(), lane.start(), "a link repeats, or leads to the lane itself");
    }
}

fn bends(lane: &TracedLane<'_>, flaws: &mut Flaws) {
    let arc = lane.line.arc();
    let bent = (1..lane.line.segments()).find_map(|i| {
        let turn = (lane.unit(i) - lane.unit(i - 1)).norm();
        let over = 0.5 * (arc[i + 1] - arc[i - 1]);
        (turn > MAX_CURVATURE * over + TURN_TOLERANCE).then_some((i, turn, over))
    });
    if let Some((i, turn, over)) = bent {
        let found = format!("turns by {:.2} degrees within {over:.2} m", turn.to_degrees());
        flaws.add(Rule::CentreLine, lane.id(), lane.line.points()[i], found);
    }
    // A line of which every segment advances along the chord does not cross itself.
    let chord = lane.end() - lane.start();
    let pieces: Vec<_> = lane.segments().collect();
    if !pieces.iter().all(|(a, b)| (b - a).dot(&chord) > 0.0)
        && let Some(at) = first_crossing(&pieces, |a, b| a.abs_diff(b) > 1)
    {
        flaws.add(Rule::CentreLine, lane.id(), at, "the centre line crosses itself");
    }
}

fn outline(lane: &TracedLane<'_>, flaws: &mut Flaws) {
    let middle = lane.line.at(0.5 * lane.line.length());
    if lane.ring.len() < 3 {
        flaws.add(Rule::Outline, lane.id(), middle, format!("{} corners", lane.ring.len()));
        return;
    }
    let around = lane.ring.len();
    let mut all: Vec<_> = lane.ring.iter().copied().zip(lane.ring.iter().copied().cycle().skip(1)).collect();
    let simple = first_crossing(&all, |a, b| a.abs_diff(b) > 1 && a.abs_diff(b) + 1 < around);
    if let Some(at) = simple {
        flaws.add(Rule::Outline, lane.id(), at, "the outline crosses itself");
        return;
    }
    // The ends of the centre line are on the outline.
    all.extend(lane.segments());
    let ((a, b), last) = (all[around], all.len() - 1);
    all[around].0 += (b - a) * 0.05;
    let (a, b) = all[last];
    all[last].1 -= (b - a) * 0.05;
    if let Some(at) = first_crossing(&all, |a, b| (a < around) != (b < around)) {
        flaws.add(Rule::Outline, lane.id(), at, "the centre line leaves the outline");
    } else if !lane.contains(middle, 0.0) {
        flaws.add(Rule::Outline, lane.id(), middle, "the centre line is outside the outline");
    }
}
