//! Next-token prediction as a task for the learner.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::scene::Scenario;
use reactsim::training::{Output, Stream, Sums, Task, View};
use serde::{Deserialize, Serialize};

use super::super::reactive::known_map::KnownMap;
use super::super::reactive::{Config, Network, Policy};
use super::super::tokens::{Class, Vocabulary};
use super::drive::Noise;
use super::loss::{Smoothing, Spread, losses};
use super::sample::{Augmentation, Sample, sample};
use crate::models::learning::LearningScene;
use crate::models::nn::Initializer;

/// What decides about learning, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: Config,
    /// How many agents of a scene are learnt from, nearest to the AV first.
    pub agents: usize,
    /// How scenes are varied.
    pub augmentation: Augmentation,
    /// How labels are smoothed.
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
                noise: Noise { wrong: 0.2, among: 6, remains: 0.5 },
            },
            smoothing: Smoothing { uniform: 0.0, spatial: 0.1 },
        }
    }
}

/// The task.
pub struct NextToken {
    recipe: Recipe,
    vocabulary: Vocabulary,
    device: Device,
    /// On the device with gradients, and on the one without.
    spread: [Spread; 2],
}

impl NextToken {
    /// A task on this device, which is one without autodiff.
    pub fn new(recipe: Recipe, vocabulary: Vocabulary, device: &Device) -> Self {
        let device = device.clone();
        let spread = [device.clone().autodiff(), device.clone()]
            .map(|d| Spread::of(&vocabulary, &recipe.smoothing, &d));
        Self { recipe, vocabulary, device, spread }
    }

    /// The vocabulary.
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
        // While validating there is no stream and no autodiff.
        let (spread, device) = match stream {
            Some(_) => (&self.spread[0], self.device.clone().autodiff()),
            None => (&self.spread[1], self.device.clone()),
        };
        let found = losses(model, samples, spread, &self.recipe.network, &device);
        let mut metrics = Sums::new();
        metrics.add("accuracy", found.right, found.weight);
        metrics.add("surprise", found.surprise, found.weight);
        Output { loss: found.loss, items: found.weight, metrics }
    }

    fn file(&self, model: &Network, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        let (config, vocabulary) = (self.recipe.network, self.vocabulary.clone());
        // The vocabulary was read from text and files: it can be written again.
        Policy { config, vocabulary, network: model.clone() }.write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        serde_json::json!({ "recipe": self.recipe, "vocabulary": self.vocabulary.provenance() })
    }
}
