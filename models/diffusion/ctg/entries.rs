//! The baselines of this network.

use reactsim_baseline::{Baseline, ModelError, Setup};
use reactsim_nn::device_of;
use reactsim_rollout::Controller;
use serde::{Deserialize, Serialize};

use super::network::Decoding;
use super::{CtgParameters, CtgPolicy, CtgSimulator};

/// Baseline that executes cloned behaviour.
pub const CTG_CLONING: Baseline = Baseline::of_network(
    "ctg-cloning",
    include_str!("cards/ctg_cloning.toml"),
    include_str!("ranges/ctg_cloning.toml"),
    cloning,
);

/// Baseline that samples plans.
pub const CTG_DIFFUSION: Baseline = Baseline::of_network(
    "ctg-diffusion",
    include_str!("cards/ctg_diffusion.toml"),
    include_str!("ranges/ctg_diffusion.toml"),
    diffusion,
);

/// Diffusion, guided by rules.
pub const CTG_GUIDED: Baseline =
    Baseline { id: "ctg-guided", card: include_str!("cards/ctg_guided.toml"), ..CTG_DIFFUSION };

/// Parameters on the card of the baseline that clones.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct CloningParameters {
    /// Number of agents that are planned, the nearest to the AV.
    agents: usize,
}

/// Returns the id and the parameters of the baseline that a network of this kind is for.
///
/// # Errors
/// [`ModelError`] if the card cannot be read; a test rules it out.
pub(super) fn plain(decoding: Decoding) -> Result<(&'static str, CtgParameters), ModelError> {
    match decoding {
        Decoding::Cloning => {
            let CloningParameters { agents } = CTG_CLONING.parameters()?;
            Ok((CTG_CLONING.id, CtgParameters::cloning(agents)))
        }
        Decoding::Diffusion => Ok((CTG_DIFFUSION.id, CTG_DIFFUSION.parameters()?)),
    }
}

fn cloning(setup: Setup) -> Result<Controller, ModelError> {
    let CloningParameters { agents } = setup.parameters()?;
    make(&setup, Decoding::Cloning, CtgParameters::cloning(agents))
}

fn diffusion(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    make(&setup, Decoding::Diffusion, parameters)
}

fn make(setup: &Setup, decoding: Decoding, parameters: CtgParameters) -> Result<Controller, ModelError> {
    let device = device_of(setup.backend);
    let policy = setup.read_weights(|bytes| {
        let policy = CtgPolicy::read(bytes, &device)?;
        policy.expect(decoding).map(|()| policy)
    })?;
    Ok(Controller::Fair(Box::new(CtgSimulator::new(setup.id, policy, parameters, device))))
}
