//! The network of SMART in a fine-tuning by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::super::policy_loss::Choice;
use super::super::super::realism::{Driven, Group};
use super::super::super::smoothing::Smoothing;
use super::super::super::token_loss::{Chooser, Target};
use super::super::{Smart, SmartPolicy};
use super::sample::Futures;
use super::token_learning::TokenLearning;
use super::{Recipe, Sample};

/// The network that drives as `smart` does, with the map of the recipe, and learns from the tokens nearest to
/// what agents did.
pub(crate) struct DrivenSmart {
    /// The first network, on the device with autodiff.
    first: Smart,
    /// Number of agents that learn, the AV included.
    agents: usize,
    tokens: TokenLearning,
}

impl DrivenSmart {
    /// Begins with a policy on this device with autodiff.
    pub(crate) fn new(first: SmartPolicy, agents: usize, device: &Device) -> Self {
        let SmartPolicy { vocabulary, map_vocabulary, network, .. } = first;
        let smoothing = Smoothing { uniform: 0.0, spatial: 0.0 };
        let tokens = TokenLearning::new(vocabulary, map_vocabulary, &smoothing, device);
        Self { first: network, agents, tokens }
    }
}

impl Driven for DrivenSmart {
    type Network = Smart;
    type Notes = ();
    type Sample = Sample;

    /// Embeddings of tokens stay as they are.
    fn first(&self) -> Smart {
        self.first.clone().with_frozen_embeddings()
    }

    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tokens.controller_within(network, Recipe::default().map_radius)
    }

    fn noting(&self, network: &Smart) -> Result<(Controller, ()), String> {
        Ok((self.controller(network)?, ()))
    }

    fn samples(&self, (): &(), scenario: &Scenario, group: &Group) -> Vec<(Sample, Vec<Choice>)> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tokens;
        let recipe = Recipe { agents: usize::MAX, ..Recipe::default() };
        let futures = Futures::of(scenario, &recipe, self.first.config(), vocabulary, map_vocabulary);
        let Some(mut futures) = futures else { return Vec::new() };
        let sample = |(rollout, tracks): (usize, &Vec<_>)| {
            let (sample, choosers) = futures.sample(tracks)?;
            let choice = |(drawn, chooser): (&Target, &Chooser)| {
                let advantage = group.advantage(rollout, chooser.slot, chooser.frame);
                // A weight by what agents did would bias the gradient.
                let drawn = Target { weight: 1.0, ..*drawn };
                (1..self.agents).contains(&chooser.slot).then_some(Choice { drawn, advantage })
            };
            let choices = sample.targets.iter().zip(&choosers).filter_map(choice).collect();
            Some((sample, choices))
        };
        group.rollouts.iter().enumerate().filter_map(sample).collect()
    }

    fn loss(&self, network: &Smart, samples: &[(Sample, Vec<Choice>)], anchor: f64) -> Output {
        let (scenes, choices): (Vec<_>, Vec<_>) =
            samples.iter().map(|(sample, choices)| (&sample.scene, choices)).unzip();
        self.tokens.policy_loss(network, &self.first.valid(), &scenes, &choices, anchor)
    }

    fn file(&self, network: &Smart, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.tokens.file(network, metadata)
    }
}
