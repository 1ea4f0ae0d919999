//! The reactive network in a fine-tuning by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use reactsim_nn::training::{Output, Sums};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::entries::REACTIVE;
use super::super::policy_loss::{Choice, policy_loss};
use super::super::reactive::notes::{Drawn, NotedStep, Notes};
use super::super::reactive::{Network, Policy, ReactiveSimulator};
use super::super::realism::{Driven, Group};
use super::super::sampling::Driving;
use super::super::token_loss::Target;

/// The network that drives as `ntp-reactive` does, and learns from the tokens that it drew.
///
/// Gradients are those of the nodes that draw. What these attend to is given: features of places, of other
/// agents and of earlier steps are the ones that the simulator computed.
pub(crate) struct DrivenReactive {
    /// The first network, on the device with autodiff.
    first: Policy,
    driving: Driving,
    /// Number of agents that learn, the AV included.
    agents: usize,
    /// Device without autodiff.
    device: Device,
}

impl DrivenReactive {
    /// Begins with a policy on this device with autodiff. The error is a message.
    pub(crate) fn new(first: Policy, agents: usize, device: &Device) -> Result<Self, String> {
        let driving = REACTIVE.parameters().map_err(|error| error.to_string())?;
        Ok(Self { first, driving, agents, device: device.clone() })
    }

    fn policy(&self, network: &Network) -> Policy {
        Policy { network: network.clone(), ..self.first.clone() }
    }

    fn simulator(&self, network: &Network) -> ReactiveSimulator {
        ReactiveSimulator::new(self.policy(network), self.driving, self.device.clone())
    }
}

impl Driven for DrivenReactive {
    type Network = Network;
    type Notes = Notes;
    type Sample = NotedStep;

    fn first(&self) -> Network {
        self.first.network.clone()
    }

    fn controller(&self, network: &Network) -> Result<Controller, String> {
        Ok(Controller::Fair(Box::new(self.simulator(network))))
    }

    fn noting(&self, network: &Network) -> Result<(Controller, Notes), String> {
        let notes = Notes::new(self.first.network.valid(), self.agents);
        let simulator = self.simulator(network).with_notes(notes.clone());
        Ok((Controller::Fair(Box::new(simulator)), notes))
    }

    fn samples(&self, notes: &Notes, _scenario: &Scenario, group: &Group) -> Vec<(NotedStep, Vec<Choice>)> {
        let choice = |(row, drawn): (usize, &Drawn)| {
            let Drawn { episode, slot, frame, class, token } = *drawn;
            let drawn = Target { row, class, token, weight: 1.0 };
            Choice { drawn, advantage: group.advantage(episode, slot, frame) }
        };
        let sample = |step: NotedStep| {
            let choices = step.drawn.iter().enumerate().map(choice).collect();
            (step, choices)
        };
        notes.take().into_iter().map(sample).collect()
    }

    /// Scores are divided by the temperature with which tokens are drawn.
    fn loss(&self, network: &Network, samples: &[(NotedStep, Vec<Choice>)], anchor: f64) -> Output {
        let temperature = self.driving.sampling.temperature;
        let (learning, reference) = (self.device.clone().autodiff(), self.first.network.valid());
        let mut all = Output::new(Tensor::zeros([1], &learning), 0.0, Sums::new());
        for (step, choices) in samples {
            let nodes = step.nodes.clone().tensors(&self.first.config, &learning);
            let features = network.encode_among(&nodes, &step.sources.with_autodiff());
            let scores = |class, rows| network.logits(class, features.clone().select(0, rows)) / temperature;
            let fixed =
                |class, rows| reference.logits(class, step.reference.clone().select(0, rows)) / temperature;
            let own = policy_loss(choices, anchor, &learning, scores, fixed);
            all.loss = all.loss + own.loss;
            all.items += own.items;
            all.metrics.extend(&own.metrics);
        }
        all
    }

    fn file(&self, network: &Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(network).write(metadata).ok()
    }
}
