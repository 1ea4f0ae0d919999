//! Ends of the roads of a map, where traffic leaves it.

use reactsim_geometry::{Vec2, direction};
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Start};

/// Distance in metres past the end of a lane at which another lane means that the road continues.
const CONTINUATION: f64 = 2.0;
/// Distance in metres past the end within which the front of a vehicle has just passed it.
const PASSED_DISTANCE: f64 = 12.0;
/// Distance in metres to the side of the lane within which a vehicle is on it.
const PASSED_OFFSET: f64 = 2.5;
/// Speed in m/s from which a vehicle is thought to leave: slower ones may stand at a dead end.
const LEAVING_SPEED: f64 = 0.5;
/// Cosine of the largest angle between a vehicle that leaves and the lane.
const ALIGNED: f64 = 0.7;

/// Ends of lanes without a successor, past which the map has no lane.
pub(super) struct RoadEnds {
    /// Last point of the lane, metres, and its direction.
    ends: Vec<(Vec2, Vec2)>,
}

impl RoadEnds {
    /// Finds the ends of the roads of a map.
    pub(super) fn new(start: &Start) -> Self {
        let road = start.map.road();
        let mut hits = Vec::new();
        let mut ends = Vec::new();
        for lane in start.map.lanes.iter().filter(|lane| lane.successors.is_empty()) {
            let (before, end) = lane.baseline.segment(lane.baseline.segments() - 1);
            let direction = (end - before).normalize();
            road.lanes_at(end + direction * CONTINUATION, &mut hits);
            if hits.is_empty() {
                ends.push((end, direction));
            }
        }
        Self { ends }
    }

    /// Returns whether the front of a vehicle passes the end of a road within a step.
    pub(super) fn reaches(&self, agent: &Agent, state: AgentState) -> bool {
        if agent.kind == AgentKind::Pedestrian || state.speed() < LEAVING_SPEED {
            return false;
        }
        let ahead = direction(state.heading);
        let front = state.position() + ahead * (0.5 * agent.length + state.speed() * DT);
        self.ends.iter().any(|(end, along)| {
            let past = front - *end;
            (0.0..=PASSED_DISTANCE).contains(&past.dot(along))
                && along.perp(&past).abs() <= PASSED_OFFSET
                && ahead.dot(along) >= ALIGNED
        })
    }
}
