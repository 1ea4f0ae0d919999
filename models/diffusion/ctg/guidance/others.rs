//! Motion of agents that are not planned.

use reactsim_nn::perception::{SceneView, forecast};
use reactsim_scene::AgentState;

use super::Other;
use crate::joint_plan::go_on;

/// Returns the present agents besides those in the slots `planned`, for this number of steps. The AV is
/// forecast to keep its acceleration and yaw rate for some time; others keep their velocity, as they will.
pub(crate) fn others(view: &SceneView<'_>, planned: &[usize], steps: usize) -> Vec<Other> {
    let other = |slot: usize| {
        let now = view.state(slot)?;
        let mut states = if slot == 0 {
            forecast(&view.tracks[0], view.now, view.av_next)?
        } else {
            let v = view.velocity(slot);
            go_on(AgentState { vx: v.x, vy: v.y, ..now }, steps)
        };
        states.truncate(steps);
        let agent = &view.agents[slot];
        Some(Other::of([agent.length, agent.width], &states))
    };
    (0..view.agents.len()).filter(|slot| !planned.contains(slot)).filter_map(other).collect()
}
