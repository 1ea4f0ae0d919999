//! Every agent keeps its velocity and its heading.

use reactsim_rollout::{Controller, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::{AgentState, DT, Start};

use crate::{Baseline, ModelError, Setup};

/// Its entry in the list of baselines.
pub const ENTRY: Baseline =
    Baseline::of_rules("constant-velocity", include_str!("constant_velocity/card.toml"), "", make);

fn make(_: Setup) -> Result<Controller, ModelError> {
    Ok(Controller::Fair(Box::new(ConstantVelocity)))
}

/// Simulator whose agents keep their current velocity; an agent of unknown velocity stands.
#[derive(Clone, Copy, Debug)]
pub struct ConstantVelocity;

impl SingleEpisode for ConstantVelocity {
    type Memory = ();

    fn id(&self) -> &'static str {
        ENTRY.id
    }

    fn begin(&self, _start: &Start, _stream: &mut Stream) {}

    fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for agent in 0..episode.plan.agents() {
            let Some(now) = episode.seen.state(agent) else { continue };
            let velocity = now.velocity().unwrap_or_default();
            for k in 0..episode.plan.steps() {
                let p = now.position() + velocity * (DT * (k + 1) as f64);
                let state = AgentState { x: p.x, y: p.y, vx: velocity.x, vy: velocity.y, ..now };
                episode.plan.set(agent, k, Some(state));
            }
        }
        Ok(())
    }
}
