//! Next-token prediction as a training task.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::scene::Scenario;
use reactsim::training::{Output, Stream, Sums, Task, View};
use serde::{Deserialize, Serialize};

use super::super::reactive::{Config, Network, Policy};
use super::super::tokens::Vocabulary;
use super::drive::Perturbation;
use super::loss::{Smoothing, TargetDistributions, losses};
use super::sample::{Augmentation, Sample, sample};
use crate::models::learning::LearningScene;
use crate::models::nn::Initializer;
use crate::models::perception::{Class, KnownMap};

/// Settings of training, in addition to the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: Config,
    /// Number of agents per scenario to learn from, nearest to the AV first.
    pub agents: usize,
    /// Data augmentation.
    pub augmentation: Augmentation,
    /// Label smoothing.
    pub smoothing: Smoothing,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: Config::default(),
            agents: 40,
            augmentation: Augmentation {
                mirror: 0.5,
                stretch: 0.1,
                shift: 4,
                window: 8,
                blind: 0.1,
                noise: Perturbation { wrong: 0.2, among: 6, remains: 0.5 },
            },
            smoothing: Smoothing { uniform: 0.0, spatial: 0.1 },
        }
    }
}

/// The training task of next-token prediction.
pub struct NextToken {
    recipe: Recipe,
    vocabulary: Vocabulary,
    device: Device,
    /// Target distributions on the device with gradients and on the one without.
    target_distributions: [TargetDistributions; 2],
}

impl NextToken {
    /// Builds a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, vocabulary: Vocabulary, device: &Device) -> Self {
        let device = device.clone();
        let target_distributions = [device.clone().autodiff(), device.clone()]
            .map(|d| TargetDistributions::of(&vocabulary, &recipe.smoothing, &d));
        Self { recipe, vocabulary, device, target_distributions }
    }

    /// Returns the vocabulary.
    pub fn vocabulary(&self) -> &Vocabulary {
        &self.vocabulary
    }
}

impl Task for NextToken {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Network;

    fn init(&self, seed: u64) -> Network {
        let tokens = Class::ALL.map(|c| self.vocabulary.tokens(c));
        let device = self.device.clone().autodiff();
        Network::init(&self.recipe.network, tokens, &mut Initializer::new(seed, &device))
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<Sample> {
        let scene =
            LearningScene::of(scenario, KnownMap::of(&scenario.start, self.recipe.network.map_radius));
        let (config, most) = (&self.recipe.network, self.recipe.agents);
        let augmentation = &self.recipe.augmentation;
        match view {
            View::Varied(stream) => {
                sample(scene, config, &self.vocabulary, most, Some((augmentation, stream)))
            }
            View::Plain => sample(scene, config, &self.vocabulary, most, None),
        }
    }

    fn loss(&self, model: &Network, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        // Validation has neither a stream nor autodiff.
        let (target_distributions, device) = match stream {
            Some(_) => (&self.target_distributions[0], self.device.clone().autodiff()),
            None => (&self.target_distributions[1], self.device.clone()),
        };
        let sums = losses(model, samples, target_distributions, &self.recipe.network, &device);
        let mut metrics = Sums::new();
        metrics.add("accuracy", sums.right, sums.weight);
        metrics.add("surprise", sums.surprise, sums.weight);
        Output { loss: sums.loss, items: sums.weight, metrics }
    }

    fn file(&self, model: &Network, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        let (config, vocabulary) = (self.recipe.network, self.vocabulary.clone());
        // Writing cannot fail: the vocabulary was read from text and files.
        Policy { config, vocabulary, network: model.clone() }.write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        serde_json::json!({ "recipe": self.recipe, "vocabulary": self.vocabulary.provenance() })
    }
}
