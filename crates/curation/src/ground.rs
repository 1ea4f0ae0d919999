//! Checks of the drivable area and of the lateral acceleration of a trajectory.

use reactsim_geometry::wrap;
use reactsim_scene::{Agent, AgentState, DT, Road, Scenario, Start};

/// The drivable area of a scenario, queried with the corners of the AV.
pub(super) struct Ground<'a> {
    road: Road<'a>,
    start: &'a Start,
    av: &'a Agent,
}

impl<'a> Ground<'a> {
    pub(super) fn new(scenario: &'a Scenario) -> Self {
        Self { road: scenario.start.road(), start: &scenario.start, av: &scenario.start.agents[0] }
    }

    /// Returns the largest distance by which a corner of the AV leaves the drivable area, metres (0 if
    /// none does). The search stops beyond `enough`. `None` if the map has no drivable area.
    pub(super) fn depth(&self, future: &[AgentState], enough: f64) -> Option<f64> {
        if !self.road.has_drivable_area() {
            return None;
        }
        let mut deepest = 0.0_f64;
        let mut near = [None; 4];
        let heights = self.start.heights_on_way(0, future);
        for (k, state) in future.iter().enumerate() {
            let height = heights.get(k).copied().unwrap_or(f64::NAN);
            let road = self.road.on_level(state.position(), height);
            for (corner, near) in state.footprint(self.av).corners().into_iter().zip(&mut near) {
                deepest = deepest.max(road.distance_off_road(corner, near)?);
            }
            if deepest > enough {
                break;
            }
        }
        Some(deepest)
    }
}

/// Returns the largest lateral acceleration of a trajectory, m/s²: speed times yaw rate of every step.
pub(super) fn lateral_acceleration(now: &AgentState, future: &[AgentState]) -> f64 {
    let previous = std::iter::once(now).chain(future);
    let each = previous.zip(future).map(|(before, state)| {
        let distance = (state.position() - before.position()).norm();
        distance * wrap(state.heading - before.heading).abs() / (DT * DT)
    });
    each.fold(0.0, f64::max)
}
