//! Motion of agents that are not planned.

use reactsim_nn::perception::{SceneView, forecast};
use reactsim_scene::{AgentState, DT};

use super::Other;

/// Returns the present agents besides those in the slots `planned`, for this number of steps. The AV is
/// forecast to keep its acceleration and yaw rate for some time; others keep their velocity, as they will.
pub(crate) fn others(view: &SceneView<'_>, planned: &[usize], steps: usize) -> Vec<Other> {
    let other = |slot: usize| {
        let now = view.state(slot)?;
        let mut states = if slot == 0 {
            forecast(&view.tracks[0], view.now, view.av_next)?
        } else {
            let v = view.velocity(slot);
            let after = |k: usize| {
                let p = now.position() + v * (k as f64 * DT);
                AgentState { x: p.x, y: p.y, vx: v.x, vy: v.y, ..now }
            };
            (1..=steps).map(after).collect()
        };
        states.truncate(steps);
        let agent = &view.agents[slot];
        Some(Other::of([agent.length, agent.width], &states))
    };
    (0..view.agents.len()).filter(|slot| !planned.contains(slot)).filter_map(other).collect()
}
