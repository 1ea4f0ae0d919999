//! The leader of a vehicle in its lane.

use reactsim_geometry::{Polyline, Vec2, direction};
use reactsim_scene::{AgentKind, FRAMES, LaneHit, Road, Scenario};

use super::lanes;

/// Maximum gap to a leader, metres between bumpers.
pub(super) const LEADER_RANGE: f64 = 60.0;
/// Lateral overlap of the boxes, metres, above which a vehicle blocks the path; a vehicle parked next to
/// the lane does not.
const BLOCKING_OVERLAP: f64 = 0.4;
/// Cosine of the maximum angle (45°) between the leader and the path.
const MIN_ALIGNMENT: f64 = 0.7;
/// Minimum distance between two points of a path, metres.
const MIN_POINT_SPACING: f64 = 0.5;

/// The vehicle ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Leader {
    /// Index of the agent.
    pub(super) agent: usize,
    /// Bumper-to-bumper gap along the path, metres.
    pub(super) gap: f64,
}

/// Returns the leader of a vehicle at a frame: the next vehicle on the path that the vehicle takes in the
/// log, continued along the lanes beyond the end of the log. The log tells which branch of a junction the
/// vehicle takes; overlapping lanes do not. `None` without a leader, and for a vehicle outside all lanes.
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
        let reach = LEADER_RANGE + 0.5 * (me.length + about.length);
        // A vehicle behind is not a leader, unless the path turns back within a few metres.
        let ahead = d.dot(&direction(here.heading)) > -0.3 * LEADER_RANGE;
        if other != agent && about.kind == AgentKind::Vehicle && d.norm() < reach && ahead {
            near.push(other);
        }
    }
    if near.is_empty() {
        return None;
    }
    let path = path_ahead(scenario, road, agent, frame, hits)?;
    let leaders = near.into_iter().filter_map(|other| {
        let (there, about) = (scenario.logged_at(other, frame)?, &scenario.start.agents[other]);
        let at = path.project(there.position());
        let (a, b) = path.segment(at.segment);
        let beside = at.distance > 0.5 * (me.width + about.width) - BLOCKING_OVERLAP;
        let along = (b - a).dot(&direction(there.heading)) > MIN_ALIGNMENT * (b - a).norm();
        let gap = at.s - 0.5 * (me.length + about.length);
        (at.s > 0.0 && !beside && along && gap < LEADER_RANGE)
            .then_some(Leader { agent: other, gap: gap.max(0.0) })
    });
    leaders.min_by(|a, b| a.gap.total_cmp(&b.gap))
}

/// Returns the path ahead of a vehicle: the logged positions of its centre, then the lanes.
fn path_ahead(
    scenario: &Scenario,
    road: &Road<'_>,
    agent: usize,
    frame: usize,
    hits: &mut Vec<LaneHit>,
) -> Option<Polyline> {
    let mut last = scenario.logged_at(agent, frame)?;
    let mut points: Vec<Vec2> = vec![last.position()];
    let mut length = 0.0;
    let longest = LEADER_RANGE + 20.0;
    for state in (frame + 1..FRAMES).filter_map(|f| scenario.logged_at(agent, f)) {
        let step = state.position() - points[points.len() - 1];
        // Standing vehicles jitter: only forward motion counts.
        if step.norm() >= MIN_POINT_SPACING && step.dot(&direction(last.heading)) > 0.0 {
            points.push(state.position());
            length += step.norm();
            last = state;
        }
        if length >= longest {
            break;
        }
    }
    if length < longest {
        points.extend(lanes::route_ahead(road, &last, longest - length, hits));
    }
    Polyline::new(&points).ok()
}
