//! Every agent brakes to a halt and stays there.

use reactsim_rollout::{Controller, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::{AgentState, DT, Start};
use serde::Deserialize;

use crate::{Baseline, ModelError, Setup};

/// Its entry in the list of baselines.
pub const ENTRY: Baseline =
    Baseline::of_rules("stop", include_str!("stop/card.toml"), include_str!("stop/ranges.toml"), make);

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    Ok(Controller::Fair(Box::new(Stop { parameters })))
}

/// Simulator whose agents brake along their current velocity at a constant rate.
#[derive(Clone, Debug)]
pub struct Stop {
    parameters: Parameters,
}

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    /// Deceleration, m/s².
    deceleration: f64,
}

impl SingleEpisode for Stop {
    type Memory = ();

    fn id(&self) -> &'static str {
        ENTRY.id
    }

    fn begin(&self, _start: &Start, _stream: &mut Stream) {}

    fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for agent in 0..episode.plan.agents() {
            let Some(mut state) = episode.seen.state(agent) else { continue };
            for k in 0..episode.plan.steps() {
                let velocity = state.velocity().unwrap_or_default();
                let speed = velocity.norm();
                let slower = (speed - self.parameters.deceleration * DT).max(0.0);
                let next = if speed > 0.0 { velocity * (slower / speed) } else { velocity };
                // The engine reports position differences as velocities, so the step itself is the velocity.
                let p = state.position() + next * DT;
                state = AgentState { x: p.x, y: p.y, vx: next.x, vy: next.y, ..state };
                episode.plan.set(agent, k, Some(state));
            }
        }
        Ok(())
    }
}
