//! Recorded tracks.

use reactsim_scene::{AgentKind, Frame, Scenario};

/// Visits the logged track of every agent of a scenario, including those that are not simulated.
pub fn for_each_track(scenario: &Scenario, mut visit: impl FnMut(AgentKind, &[Frame])) {
    for (i, agent) in scenario.start.agents.iter().enumerate() {
        visit(agent.kind, &scenario.logged(i));
    }
    for other in &scenario.unselected {
        visit(other.agent.kind, &other.track);
    }
}
