//! The baselines of this network.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_rollout::Controller;

use super::{VbdParameters, VbdPolicy, VbdSimulator};

/// Baseline that samples joint plans.
pub const VBD: Baseline = entry("vbd", include_str!("cards/vbd.toml"));

/// The same with the AV's plan fixed to the continuation of its executed motion.
pub const VBD_INPAINTING: Baseline = entry("vbd-inpainting", include_str!("cards/vbd_inpainting.toml"));

const fn entry(id: &'static str, card: &'static str) -> Baseline {
    Baseline {
        id,
        card,
        ranges: include_str!("ranges.toml"),
        oracle: false,
        takes_stage: true,
        by_default: false,
        needs_weights: true,
        make,
    }
}

/// Returns the parameters on the card.
///
/// # Errors
/// [`ModelError`] if the card cannot be read; a test rules it out.
pub(super) fn parameters() -> Result<VbdParameters, ModelError> {
    Setup::new(VBD.id, VBD.card, VBD.ranges, None)?.parameters()
}

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = VbdPolicy::read(&setup.weights()?.bytes, &device).map_err(|e| setup.refuse_weights(e))?;
    Ok(Controller::Fair(Box::new(VbdSimulator::new(setup.id, policy, parameters, device))))
}
