//! The reactive agents of nuPlan's closed-loop simulations as a simulator. Their rules are those of
//! `reactsim_planning::idm_agents`; this crate connects them with scenarios.

mod traffic;

#[cfg(test)]
mod tests;

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_planning::idm_agents::Parameters;
use reactsim_rollout::{Controller, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::Start;
use serde::Deserialize;

use self::traffic::Traffic;

/// Its entry in the list of baselines.
pub const ENTRY: Baseline = Baseline {
    id: "nuplan-idm",
    card: include_str!("card.toml"),
    ranges: include_str!("ranges.toml"),
    oracle: false,
    takes_stage: true,
    by_default: false,
    needs_weights: false,
    make,
};

/// Parameters of the card.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct CardParameters {
    target_speed: f64,
    min_gap: f64,
    headway: f64,
    acceleration: f64,
    deceleration: f64,
    min_path: f64,
    radius: f64,
}

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let CardParameters { target_speed, min_gap, headway, acceleration, deceleration, min_path, radius } =
        setup.parameters()?;
    let parameters =
        Parameters { target_speed, min_gap, headway, acceleration, deceleration, min_path, radius };
    Ok(Controller::Fair(Box::new(NuplanIdm { parameters })))
}

/// Simulator whose vehicles are the reactive agents of nuPlan.
#[derive(Clone, Debug)]
pub struct NuplanIdm {
    parameters: Parameters,
}

impl SingleEpisode for NuplanIdm {
    type Memory = Traffic;

    fn id(&self) -> &'static str {
        ENTRY.id
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> Traffic {
        Traffic::begin(start)
    }

    fn resume(
        &self,
        before: Traffic,
        kept: &[Option<usize>],
        start: &Start,
        _stream: &mut Stream,
    ) -> Traffic {
        before.resumed(kept, start)
    }

    fn plan_one(&self, traffic: &mut Traffic, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        traffic.plan(&self.parameters, episode)
    }
}
