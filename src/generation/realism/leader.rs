//! Who drives ahead in the lane.

use super::lanes;
use crate::geometry::{Polyline, Vec2, direction};
use crate::scene::{AgentKind, FRAMES, LaneHit, Road, Scenario};

/// A leader farther away than this is none, metres between the bumpers.
pub(super) const RANGE: f64 = 60.0;
/// A vehicle is in the way when the boxes would overlap sideways by this, metres: one parked beside the lane is not.
const IN_THE_WAY: f64 = 0.4;
/// A leader heads along the way within this angle: its cosine (45°).
const ALONG: f64 = 0.7;
/// Two points of a way are at least this far apart, metres.
const SPACING: f64 = 0.5;

/// The vehicle ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leader {
    /// Its index.
    pub(super) agent: usize,
    /// From bumper to bumper along the way, metres.
    pub(super) gap: f64,
}

/// The leader of a vehicle at a frame: who is next on the way that it takes in the log, and beyond the end of the log over the lanes. The
/// log tells which branch of a junction is meant, which lanes that overlap do not. `None` without one, and for who is in no lane.
pub(super) fn leader(
    scenario: &Scenario,
    road: &Road<'_>,
    agent: usize,
    frame: usize,
    hits: &mut Vec<LaneHit>,
) -> Option<Leader> {
    let here = scenario.logged_at(agent, frame)?;
    lanes::lane_of(road, &here, hits)?;
    let me = &scenario.start.agents[agent];
    let mut near: Vec<usize> = Vec::new();
    for (other, about) in scenario.start.agents.iter().enumerate() {
        let Some(there) = scenario.logged_at(other, frame) else { continue };
        let d = there.position() - here.position();
        let reach = RANGE + 0.5 * (me.length + about.length);
        // Who is behind is no leader, unless the way turns back within so few metres.
        let ahead = d.dot(&direction(here.heading)) > -0.3 * RANGE;
        if other != agent && about.kind == AgentKind::Vehicle && d.norm() < reach && ahead {
            near.push(other);
        }
    }
    if near.is_empty() {
        return None;
    }
    let way = way(scenario, road, agent, frame, hits)?;
    let leaders = near.into_iter().filter_map(|other| {
        let (there, about) = (scenario.logged_at(other, frame)?, &scenario.start.agents[other]);
        let at = way.project(there.position());
        let (a, b) = way.segment(at.segment);
        let beside = at.distance > 0.5 * (me.width + about.width) - IN_THE_WAY;
        let along = (b - a).dot(&direction(there.heading)) > ALONG * (b - a).norm();
        let gap = at.s - 0.5 * (me.length + about.length);
        (at.s > 0.0 && !beside && along && gap < RANGE).then_some(Leader { agent: other, gap: gap.max(0.0) })
    });
    leaders.min_by(|a, b| a.gap.total_cmp(&b.gap))
}

/// The way ahead of a vehicle: where its centre goes in the log, then over the lanes.
fn way(
    scenario: &Scenario,
    road: &Road<'_>,
    agent: usize,
    frame: usize,
    hits: &mut Vec<LaneHit>,
) -> Option<Polyline> {
    let mut last = scenario.logged_at(agent, frame)?;
    let mut points: Vec<Vec2> = vec![last.position()];
    let mut length = 0.0;
    let longest = RANGE + 20.0;
    for state in (frame + 1..FRAMES).filter_map(|f| scenario.logged_at(agent, f)) {
        let step = state.position() - points[points.len() - 1];
        // Vehicles that stand jitter: only what goes on counts.
        if step.norm() >= SPACING && step.dot(&direction(last.heading)) > 0.0 {
            points.push(state.position());
            length += step.norm();
            last = state;
        }
        if length >= longest {
            break;
        }
    }
    if length < longest {
        points.extend(lanes::way_on(road, &last, longest - length, hits));
    }
    Polyline::new(&points).ok()
}
