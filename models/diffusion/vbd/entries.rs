//! The baselines of this network.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_rollout::Controller;

use super::{VbdPolicy, VbdSimulator};

/// Baseline that samples joint plans.
pub const VBD: Baseline =
    Baseline::of_network("vbd", include_str!("cards/vbd.toml"), include_str!("ranges.toml"), make);

/// The same with the AV's plan fixed to the continuation of its executed motion.
pub const VBD_INPAINTING: Baseline =
    Baseline { id: "vbd-inpainting", card: include_str!("cards/vbd_inpainting.toml"), ..VBD };

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| VbdPolicy::read(bytes, &device))?;
    Ok(Controller::Fair(Box::new(VbdSimulator::new(setup.id, policy, parameters, device))))
}
