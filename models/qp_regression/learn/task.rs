//! Regression as a task for the learner.

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

/// What decides about learning, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: Config,
    /// How many agents of a scenario are learnt from at a time.
    pub agents: usize,
    /// How scenes are varied.
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

/// The task.
pub struct Regression {
    recipe: Recipe,
    intentions: Intentions,
    device: Device,
    /// The network to begin with, on a device with autodiff, and the digest of its file.
    from: Option<(Network, String)>,
    /// Whether who is parked is judged too.
    parked: bool,
}

/// Weights that a training can not begin with.
#[derive(Debug, thiserror::Error)]
pub enum FromError {
    /// They can not be read.
    #[error("the weights {0} can not be used: {1}")]
    Policy(String, PolicyError),
    /// Their network has other sizes than the recipe.
    #[error(
        "the network of {0} has other sizes than the recipe: leave the recipe's `network` as it is there"
    )]
    Sizes(String),
}

impl Regression {
    /// A task on this device, which is one without autodiff.
    pub fn new(recipe: Recipe, intentions: Intentions, device: &Device) -> Self {
        Self { recipe, intentions, device: device.clone(), from: None, parked: false }
    }

    /// A task that begins with the network of this file, and has its intention points.
    ///
    /// # Errors
    /// [`FromError`] where the file is no such network, or has other sizes than the recipe.
    pub fn going_on(recipe: Recipe, file: &WeightsFile, device: &Device) -> Result<Self, FromError> {
        let policy = Policy::read(&file.bytes, &device.clone().autodiff())
            .map_err(|error| FromError::Policy(file.name.clone(), error))?;
        if policy.config != recipe.network {
            return Err(FromError::Sizes(file.name.clone()));
        }
        let from = Some((policy.network, file.digest.clone()));
        Ok(Self { from, ..Self::new(recipe, policy.intentions, device) })
    }

    /// The same task, but whoever is parked is judged too. Learning stays as it is.
    pub fn with_parked(self) -> Self {
        Self { parked: true, ..self }
    }

    /// The network as a simulator reads it.
    pub fn policy(&self, network: &Network) -> Policy {
        Policy { config: self.recipe.network, intentions: self.intentions.clone(), network: network.clone() }
    }

    fn run(&self, model: &Network, samples: &[Sample], device: &Device) -> (Losses, Sums) {
        let found = losses(model, samples, &self.intentions, &self.recipe.network, device);
        let mut metrics = Sums::new();
        metrics.add("surprise", found.surprise.0, found.surprise.1);
        metrics.add("score", found.score, found.targets);
        metrics.add("right_query", found.right, found.targets);
        (found, metrics)
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
        // While validating there is no stream and no autodiff.
        let device = match stream {
            Some(_) => self.device.clone().autodiff(),
            None => self.device.clone(),
        };
        let (found, metrics) = self.run(model, samples, &device);
        Output { loss: found.loss, items: found.targets, metrics }
    }

    fn validate(&self, model: &Network, samples: &[Sample]) -> Output {
        let (found, mut metrics) = self.run(model, samples, &self.device);
        if let Some(last) = found.predicted.layers.into_iter().next_back() {
            measure(samples, last, &self.recipe.network, &mut metrics);
        }
        Output { loss: found.loss, items: found.targets, metrics }
    }

    fn file(&self, model: &Network, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        // What is said of the intention points was read from text, or made here: it can be written again.
        self.policy(model).write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        let points: Vec<[f64; 2]> = crate::models::ntp::tokens::Class::ALL
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
