//! The protocol as properties of every baseline, including future ones: the list of baselines is the test's
//! input.

mod conformance;
pub(crate) mod entering;
mod failures;
mod long;
mod planner;
mod reversing;
mod sight;

use reactsim::models::{Baseline, MODELS, ModelError, Setup, find, idm};
use reactsim::rollout::{Controller, Mix, MixMember, Replan, Settings};
use reactsim::scene::{AgentKind, Scenario};

use crate::model_weights::untrained;
use crate::scenes::{mini, real};
use crate::small_scenarios;

/// Replan intervals: every step, the default, one that does not divide the horizon, and a plan for the whole
/// horizon.
const INTERVALS: [usize; 4] = [1, 5, 7, 80];

/// Returns synthetic, hand-made and, if available, recorded scenarios.
pub(crate) fn scenarios(recorded: usize) -> Vec<Scenario> {
    let mut all: Vec<Scenario> = (0..2).map(small_scenarios::scenario).collect();
    all.extend(mini());
    all.extend(real(recorded));
    all
}

fn settings(replan: usize, av_lookahead: bool) -> Settings {
    Settings { replan: Replan::every(replan).unwrap(), av_lookahead, ..Settings::default() }
}

/// Mixed traffic, which must have the same properties.
const MIX: Baseline = Baseline { id: "mix", make: mixed, ..idm::ENTRY };

fn mixed(_: Setup) -> Result<Controller, ModelError> {
    let members =
        [("idm", 2.0), ("constant-velocity", 1.0), ("idm@styles", 1.0), ("stop", 0.0)].map(|(id, share)| {
            let Controller::Fair(simulator) = find(id).unwrap().simulator().unwrap() else { unreachable!() };
            let kinds = if share > 0.0 { Vec::new() } else { vec![AgentKind::Pedestrian] };
            MixMember { simulator, share, kinds }
        });
    Ok(Controller::Fair(Box::new(Mix::new(members.into()).unwrap())))
}

fn every_baseline() -> impl Iterator<Item = (&'static Baseline, Controller)> {
    MODELS.iter().chain([&MIX]).filter_map(|model| {
        let mut setup = model.setup().unwrap();
        if model.needs_weights && setup.weights.is_none() {
            // The protocol also holds for untrained weights.
            setup.weights = Some(untrained(model.id)?);
        }
        Some((model, (model.make)(setup).unwrap()))
    })
}
