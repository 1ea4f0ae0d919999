//! The reactive agents of nuPlan's closed-loop simulations as a simulator. Their rules are those of
//! `reactsim_planning::idm_agents`; this crate connects them with scenarios.

mod traffic;

#[cfg(test)]
mod tests;

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_planning::idm_agents::Parameters;
use reactsim_rollout::{Controller, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::Start;

use self::traffic::Traffic;

/// Its entry in the list of baselines.
pub const ENTRY: Baseline = Baseline {
    by_default: false,
    ..Baseline::of_rules("nuplan-idm", include_str!("card.toml"), include_str!("ranges.toml"), make)
};

fn make(setup: Setup) -> Result<Controller, ModelError> {
    Ok(Controller::Fair(Box::new(NuplanIdm { parameters: setup.parameters()? })))
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
