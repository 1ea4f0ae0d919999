//! Our network with a guard: agents execute its joint futures while that leaves them a safe way out.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_qp as qp;
use reactsim_qp::GuardSettings;
use reactsim_rollout::Controller;
use serde::{Deserialize, Serialize};

use super::haste::Haste;
use super::reactive::{Policy, ReactiveSimulator};
use super::sampling::Sampling;
use super::{Driving, entries};

/// Our network with a guard.
pub const GUARDED: Baseline = Baseline {
    id: "ntp-guarded",
    card: include_str!("cards/guarded.toml"),
    ranges: include_str!("ranges/guarded.toml"),
    takes_stage: false,
    make,
    ..entries::REACTIVE
};

/// The parameters on the card.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    /// Makes faster tokens of vehicles likelier.
    haste: Haste,
    /// Settings for drawing tokens.
    sampling: Sampling,
    /// When agents leave what the network proposes.
    guard: GuardSettings,
}

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let Parameters { haste, sampling, guard } = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| Policy::read(bytes, &device))?;
    let driving = Driving { projection: true, keep_clear: false, sampling };
    let simulator = ReactiveSimulator::new(policy, driving, device).with_haste(haste);
    qp::guarded(Box::new(simulator), guard)
}
