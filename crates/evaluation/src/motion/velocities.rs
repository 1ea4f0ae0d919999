//! Given velocities against given positions.

use reactsim_scene::{DT, VelocityContradiction};

use super::{CheckedScene, Finding};
use crate::motion::kind::RolloutCheck;

/// Checks whether velocities are those of the positions: metrics take accelerations and directions from them.
pub(super) fn finding(scene: &CheckedScene<'_>) -> Option<Finding> {
    let agents: Vec<_> = scene.agents.iter().chain(&scene.replayed).collect();
    let found = VelocityContradiction::find(agents.iter().map(|agent| agent.future), |_| DT)?;
    Some(Finding::new(
        RolloutCheck::Velocities,
        format!(
            "the velocities of {} of {} agents contradict their positions, the first of `{}`: {}; give m/s along \
             the axes of the positions, or NaN for unknown velocities",
            found.agents.len(),
            agents.len(),
            agents[found.agents[0]].id,
            found.likely
        ),
    ))
}
