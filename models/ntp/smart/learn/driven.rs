//! The network of SMART in a fine-tuning by realism.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::super::policy_loss::Choice;
use super::super::super::realism::Driven;
use super::super::super::smoothing::Smoothing;
use super::super::super::token_loss::{Chooser, Target};
use super::super::{Smart, SmartPolicy};
use super::sample::sample;
use super::token_learning::TokenLearning;
use super::{Recipe, Sample};

/// The network that drives as `smart` does, with the map of the recipe.
pub(crate) struct DrivenSmart {
    /// The first network, on the device with autodiff.
    first: Smart,
    tokens: TokenLearning,
}

impl DrivenSmart {
    /// Begins with a policy on this device with autodiff.
    pub(crate) fn new(first: SmartPolicy, device: &Device) -> Self {
        let SmartPolicy { vocabulary, map_vocabulary, network, .. } = first;
        let smoothing = Smoothing { uniform: 0.0, spatial: 0.0 };
        Self { first: network, tokens: TokenLearning::new(vocabulary, map_vocabulary, &smoothing, device) }
    }
}

impl Driven for DrivenSmart {
    type Network = Smart;
    type Sample = Sample;

    /// Embeddings of tokens stay as they are.
    fn first(&self) -> Smart {
        self.first.clone().with_frozen_embeddings()
    }

    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tokens.controller_within(network, Recipe::default().map_radius)
    }

    fn sample(&self, scenario: &Scenario) -> Option<(Sample, Vec<Chooser>)> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tokens;
        let recipe = Recipe { agents: usize::MAX, ..Recipe::default() };
        sample(scenario, &recipe, self.first.config(), vocabulary, map_vocabulary, None)
    }

    fn targets<'s>(&self, sample: &'s Sample) -> &'s [Target] {
        &sample.targets
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
