//! The baselines of this family.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_rollout::Controller;

use super::reactive::{Policy, ReactiveSimulator};
use super::smart::{SmartPolicy, SmartSimulator};

/// Units and ranges of the parameters of our network.
const REACTIVE_RANGES: &str = include_str!("ranges/reactive.toml");
/// Units and ranges of the parameters of the published network.
const SMART_RANGES: &str = include_str!("ranges/smart.toml");

/// Our network, with vehicles within kinematic limits.
pub const REACTIVE: Baseline = Baseline {
    by_default: true,
    ..Baseline::of_network("ntp-reactive", include_str!("cards/reactive.toml"), REACTIVE_RANGES, reactive)
};

/// Our network, with tokens executed exactly.
pub const REACTIVE_RAW: Baseline = Baseline::of_network(
    "ntp-reactive-raw",
    include_str!("cards/reactive_raw.toml"),
    REACTIVE_RANGES,
    reactive,
);

/// The published network, with tokens executed exactly.
pub const SMART: Baseline =
    Baseline { by_default: true, ..smart_body("smart", include_str!("cards/smart.toml")) };

/// The published network, with vehicles within kinematic limits.
pub const SMART_PROJECTED: Baseline = Baseline {
    by_default: true,
    ..smart_body("smart-projected", include_str!("cards/smart_projected.toml"))
};

/// Its body at a size for processor cores, trained here.
pub const SMART_SMALL: Baseline = smart_body("smart-small", include_str!("cards/smart_small.toml"));

/// The variant of TrajTok, trained likewise.
pub const TRAJTOK_SMALL: Baseline = smart_body("trajtok-small", include_str!("cards/trajtok_small.toml"));

/// SMART-small after closed-loop fine-tuning.
pub const CATK_SMALL: Baseline = smart_body("catk-small", include_str!("cards/catk_small.toml"));

/// SMART-small after fine-tuning by rewards, with an AV that leaves its log.
pub const SMART_REACTIVE: Baseline = smart_body("smart-reactive", include_str!("cards/smart_reactive.toml"));

const fn smart_body(id: &'static str, card: &'static str) -> Baseline {
    Baseline::of_network(id, card, SMART_RANGES, smart)
}

fn reactive(setup: Setup) -> Result<Controller, ModelError> {
    let driving = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| Policy::read(bytes, &device))?;
    Ok(Controller::Fair(Box::new(ReactiveSimulator::new(policy, driving, device))))
}

fn smart(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| SmartPolicy::read(bytes, &device))?;
    Ok(Controller::Fair(Box::new(SmartSimulator::new(setup.id, policy, parameters))))
}
