//! IDM: reactive, rule-based agents. Vehicles and cyclists drive paths over the lane graph, pedestrians
//! walk.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod actor;
mod corridor;
mod decide;
mod driver;
mod evade;
mod follow;
mod forecast;
mod heights;
mod motion;
mod own_motion;
mod parameters;
mod route;
mod signals;
mod strip;
mod styles;

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_rollout::{Controller, PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::Start;

use self::motion::Traffic;
use self::parameters::Parameters;

/// Its entry in the list of baselines.
pub const ENTRY: Baseline =
    Baseline::of_rules("idm", include_str!("card.toml"), include_str!("ranges.toml"), make);

/// Its variant whose drivers have styles.
pub const STYLES: Baseline = Baseline {
    id: "idm@styles",
    card: include_str!("styles/card.toml"),
    ranges: concat!(include_str!("ranges.toml"), include_str!("styles/ranges.toml")),
    by_default: false,
    ..ENTRY
};

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    setup.parameters.require_order("vehicle.deceleration", "limits.emergency_deceleration")?;
    setup.parameters.require_order("cyclist.deceleration", "limits.emergency_deceleration")?;
    setup.parameters.require_order("limits.jerk", "limits.emergency_jerk")?;
    setup.parameters.require_order("conflict.sample", "conflict.horizon")?;
    setup.parameters.require_order("conflict.sample", "conflict.av_horizon")?;
    Ok(Controller::Fair(Box::new(Idm { parameters })))
}

/// Rule-based drivers on the lane graph.
#[derive(Clone, Debug)]
pub struct Idm {
    parameters: Parameters,
}

impl SingleEpisode for Idm {
    type Memory = Traffic;

    fn id(&self) -> &'static str {
        ENTRY.id
    }

    fn begin(&self, start: &Start, stream: &mut Stream) -> Traffic {
        Traffic::begin(start, &self.parameters, stream)
    }

    fn resume(&self, before: Traffic, kept: &[Option<usize>], start: &Start, stream: &mut Stream) -> Traffic {
        Traffic::begin(start, &self.parameters, stream).resumed(before, kept)
    }

    fn plan_one(&self, traffic: &mut Traffic, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        traffic.plan(&self.parameters, episode);
        Ok(())
    }
}
