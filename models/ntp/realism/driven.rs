//! Networks of tokens that can be fine-tuned by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::policy_loss::Choice;
use super::group::Group;

/// A network of tokens that learns from what it did as a simulator.
pub(crate) trait Driven: Send + Sync {
    /// The network.
    type Network: Module;
    /// What a simulator notes of its rollouts.
    type Notes;
    /// Input of the network for one or several tokens.
    type Sample;

    /// Returns the network that the training begins with, on a device with autodiff.
    fn first(&self) -> Self::Network;

    /// Returns the simulator with a network without autodiff. The error is a message.
    fn controller(&self, network: &Self::Network) -> Result<Controller, String>;

    /// Returns the simulator with a network without autodiff, and what it notes. The error is a message.
    fn noting(&self, network: &Self::Network) -> Result<(Controller, Self::Notes), String>;

    /// Builds samples of a group of rollouts of a scenario, the last that the simulator of these notes has
    /// driven. The AV is external, and has no choice.
    fn samples(
        &self,
        notes: &Self::Notes,
        scenario: &Scenario,
        group: &Group,
    ) -> Vec<(Self::Sample, Vec<Choice>)>;

    /// Returns the policy gradient's loss of a network with autodiff on samples with their choices, with the
    /// weight `anchor` of the divergence from the first network.
    fn loss(&self, network: &Self::Network, samples: &[(Self::Sample, Vec<Choice>)], anchor: f64) -> Output;

    /// Returns the file of a network with these metadata.
    fn file(&self, network: &Self::Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>>;
}
