//! Networks of tokens that can be fine-tuned by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::policy_loss::Choice;
use super::super::token_loss::{Chooser, Target};

/// A network of tokens that learns from what it did as a simulator.
pub(crate) trait Driven: Send + Sync {
    /// The network.
    type Network: Module;
    /// Input of the network for a rollout, with the tokens nearest to the motion of agents.
    type Sample;

    /// Returns the network that the training begins with, on a device with autodiff.
    fn first(&self) -> Self::Network;

    /// Returns the simulator with a network without autodiff. The error is a message.
    fn controller(&self, network: &Self::Network) -> Result<Controller, String>;

    /// Builds the sample of a scenario whose future is a rollout, and says who chose each token. `None` if no
    /// agent chose any.
    fn sample(&self, scenario: &Scenario) -> Option<(Self::Sample, Vec<Chooser>)>;

    /// Returns the tokens of a sample, in the order of their choosers.
    fn targets<'s>(&self, sample: &'s Self::Sample) -> &'s [Target];

    /// Returns the policy gradient's loss of a network with autodiff on samples with their choices, with the
    /// weight `anchor` of the divergence from the first network.
    fn loss(&self, network: &Self::Network, samples: &[(Self::Sample, Vec<Choice>)], anchor: f64) -> Output;

    /// Returns the file of a network with these metadata.
    fn file(&self, network: &Self::Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>>;
}
