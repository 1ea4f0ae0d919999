//! The reactive network in a fine-tuning by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_nn::learning::{LearningScene, Window};
use reactsim_nn::perception::KnownMap;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::entries::reactive_driving;
use super::super::policy_loss::{Choice, in_batch, policy_loss};
use super::super::reactive::{Network, Policy, ReactiveSimulator};
use super::super::realism::Driven;
use super::super::sampling::Driving;
use super::super::token_loss::{Chooser, Target};
use super::loss::{encoded, first_rows};
use super::sample::{Sample, sample};

/// The network that drives as `ntp-reactive` does.
pub(crate) struct DrivenReactive {
    /// The first network, on the device with autodiff.
    first: Policy,
    driving: Driving,
    /// Device without autodiff.
    device: Device,
}

impl DrivenReactive {
    /// Begins with a policy on this device with autodiff. The error is a message.
    pub(crate) fn new(first: Policy, device: &Device) -> Result<Self, String> {
        let driving = reactive_driving().map_err(|error| error.to_string())?;
        Ok(Self { first, driving, device: device.clone() })
    }

    fn policy(&self, network: &Network) -> Policy {
        Policy { network: network.clone(), ..self.first.clone() }
    }
}

impl Driven for DrivenReactive {
    type Network = Network;
    type Sample = Sample;

    fn first(&self) -> Network {
        self.first.network.clone()
    }

    fn controller(&self, network: &Network) -> Result<Controller, String> {
        let simulator = ReactiveSimulator::new(self.policy(network), self.driving, self.device.clone());
        Ok(Controller::Fair(Box::new(simulator)))
    }

    fn sample(&self, scenario: &Scenario) -> Option<(Sample, Vec<Chooser>)> {
        let window = Window::of(scenario, None);
        let map = KnownMap::of(&window.start, self.first.config.map_radius);
        sample(LearningScene::of(window, map), &self.first.config, &self.first.vocabulary, usize::MAX, None)
    }

    fn targets<'s>(&self, sample: &'s Sample) -> &'s [Target] {
        &sample.targets
    }

    /// Scores are divided by the temperature with which tokens are drawn.
    fn loss(&self, network: &Network, samples: &[(Sample, Vec<Choice>)], anchor: f64) -> Output {
        let (config, temperature) = (&self.first.config, self.driving.sampling.temperature);
        let own: Vec<&Sample> = samples.iter().map(|(sample, _)| sample).collect();
        let choices = in_batch(samples.iter().map(|(_, choices)| choices), first_rows(&own));
        let (learning, reference) = (self.device.clone().autodiff(), self.first.network.valid());
        let nodes = encoded(network, &own, config, &learning);
        let fixed = encoded(&reference, &own, config, &self.device);
        let scores = |class, rows| network.logits(class, nodes.clone().select(0, rows)) / temperature;
        let fixed = |class, rows| reference.logits(class, fixed.clone().select(0, rows)) / temperature;
        policy_loss(&choices, anchor, &learning, scores, fixed)
    }

    fn file(&self, network: &Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(network).write(metadata).ok()
    }
}
