//! The training task of the regression network.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim::scene::Scenario;
use reactsim::training::{Output, Stream, Sums, Task, View};
use serde::{Deserialize, Serialize};

use super::super::inputs::Survey;
use super::super::network::{Config, Network};
use super::super::{Intentions, Policy, PolicyError};
use super::Disturbance;
use super::loss::{Losses, losses};
use super::measure::measure;
use super::sample::{Augmentation, Sample, sample};
use crate::models::WeightsFile;
use crate::models::learning::LearningScene;
use crate::models::nn::Initializer;
use crate::models::perception::Class;

/// Everything that determines training, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: Config,
    /// Largest number of agents of a scenario in one sample.
    pub agents: usize,
    /// Augmentation of scenes.
    pub augmentation: Augmentation,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: Config::default(),
            agents: 8,
            augmentation: Augmentation {
                mirror: 0.5,
                stretch: 0.1,
                shift: 4,
                blind: 0.1,
                disturbance: Disturbance { often: 0.3, aside: 0.6, along: 0.6, turn: 0.05, recovers: 3.0 },
            },
        }
    }
}

/// Training task of the regression network.
pub struct Regression {
    recipe: Recipe,
    intentions: Intentions,
    device: Device,
    /// Initial network, on a device with autodiff, and the digest of its file.
    from: Option<(Network, String)>,
    /// Whether parked agents are judged too.
    parked: bool,
}

/// Error of weights that training cannot start from.
#[derive(Debug, thiserror::Error)]
pub enum InitialWeightsError {
    /// The weights cannot be read.
    #[error("cannot use the weights {0}: {1}")]
    Policy(String, PolicyError),
    /// The network has other sizes than the recipe.
    #[error("the network of {0} has other sizes than the recipe: give the recipe the same `network`")]
    Sizes(String),
}

impl Regression {
    /// Creates a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, intentions: Intentions, device: &Device) -> Self {
        Self { recipe, intentions, device: device.clone(), from: None, parked: false }
    }

    /// Creates a task that starts from the network of this file and uses its intention points.
    ///
    /// # Errors
    /// [`InitialWeightsError`] if the file holds no such network, or one of other sizes than the
    /// recipe.
    pub fn from_weights(
        recipe: Recipe,
        file: &WeightsFile,
        device: &Device,
    ) -> Result<Self, InitialWeightsError> {
        let policy = Policy::read(&file.bytes, &device.clone().autodiff())
            .map_err(|error| InitialWeightsError::Policy(file.name.clone(), error))?;
        if policy.config != recipe.network {
            return Err(InitialWeightsError::Sizes(file.name.clone()));
        }
        let from = Some((policy.network, file.digest.clone()));
        Ok(Self { from, ..Self::new(recipe, policy.intentions, device) })
    }

    /// Returns the same task with parked agents judged too. Training stays the same.
    pub fn with_parked(self) -> Self {
        Self { parked: true, ..self }
    }

    /// Returns a network as the policy that a simulator reads.
    pub fn policy(&self, network: &Network) -> Policy {
        Policy { config: self.recipe.network, intentions: self.intentions.clone(), network: network.clone() }
    }

    fn run(&self, model: &Network, samples: &[Sample], device: &Device) -> (Losses, Sums) {
        let losses = losses(model, samples, &self.intentions, &self.recipe.network, device);
        let mut metrics = Sums::new();
        metrics.add("surprise", losses.surprise.0, losses.surprise.1);
        metrics.add("score", losses.score, losses.targets);
        metrics.add("right_query", losses.right, losses.targets);
        (losses, metrics)
    }
}

impl Task for Regression {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Network;

    fn init(&self, seed: u64) -> Network {
        if let Some((network, _)) = &self.from {
            return network.clone();
        }
        let device = self.device.clone().autodiff();
        Network::init(&self.recipe.network, &mut Initializer::new(seed, &device))
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<Sample> {
        let config = &self.recipe.network;
        let scene = LearningScene::of(scenario, Survey::of(&scenario.start, config));
        match view {
            View::Varied(stream) => {
                sample(scene, config, self.recipe.agents, Some((&self.recipe.augmentation, stream)), false)
            }
            View::Plain => sample(scene, config, self.recipe.agents, None, self.parked),
        }
    }

    fn loss(&self, model: &Network, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        // Validation has no stream and no autodiff.
        let device = match stream {
            Some(_) => self.device.clone().autodiff(),
            None => self.device.clone(),
        };
        let (losses, metrics) = self.run(model, samples, &device);
        Output { loss: losses.loss, items: losses.targets, metrics }
    }

    fn validate(&self, model: &Network, samples: &[Sample]) -> Output {
        let (losses, mut metrics) = self.run(model, samples, &self.device);
        if let Some(last) = losses.predicted.layers.into_iter().next_back() {
            measure(samples, last, &self.recipe.network, &mut metrics);
        }
        Output { loss: losses.loss, items: losses.targets, metrics }
    }

    fn file(&self, model: &Network, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        // The provenance of the intention points was read from text, or made here: it can be written.
        self.policy(model).write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        let points: Vec<[f64; 2]> = Class::ALL
            .into_iter()
            .flat_map(|class| self.intentions.of(class).iter().map(|p| [p.x, p.y]))
            .collect();
        let mut all = serde_json::json!({
            "recipe": self.recipe,
            "intentions": { "made": self.intentions.provenance(), "points": points },
        });
        if let Some((_, digest)) = &self.from {
            all["from"] = digest.as_str().into();
        }
        all
    }
}
