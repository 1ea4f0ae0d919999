//! Next-token prediction as a training task.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::learning::{
    LearningScene, Origin, ShippedRecipe, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable,
    TrainingTask, Window, recipe_values,
};
use reactsim_nn::perception::{Class, KnownMap};
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use serde::{Deserialize, Serialize};

use super::super::drive::Perturbation;
use super::super::entries::REACTIVE;
use super::super::reactive::{Config, Network, Policy, ReactiveSimulator};
use super::super::smoothing::{Smoothing, TargetDistributions};
use super::super::tokens::{Kinematic, Vocabulary};
use super::loss::loss;
use super::sample::{Augmentation, Sample, sample};

/// Training of our network.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &["ntp"],
    title: "Next-token prediction with the reactive network, 0.9 million weights by default",
    simulators: &[ID, "ntp-reactive-raw"],
    defaults: || recipe_values(&Recipe::default(), &Settings::default()),
    ranges: include_str!("ranges.toml"),
    recipes: &[ShippedRecipe {
        name: "quick",
        about: "0.2 million weights, a few minutes on two cores",
        text: include_str!("recipes/quick.toml"),
    }],
    inputs: &[TaskInput {
        name: VOCABULARY,
        about: "motion tokens, from `train vocabulary` or weights [default: the kinematic ones]",
        required: false,
    }],
    needs_weights: false,
    make,
};

/// Id of the task, and of the simulator that runs the network within kinematic limits.
const ID: &str = "ntp-reactive";
/// Name of the input with the tokens.
const VOCABULARY: &str = "vocabulary";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    recipe.network.check().map_err(|e| TaskError::values(ID, e))?;
    let parent = setup.parent(Policy::read, |policy| policy.config == recipe.network)?;
    let (parent, own) = parent.map(|(policy, digest)| ((policy.network, digest), policy.vocabulary)).unzip();
    let vocabulary = match setup.input(VOCABULARY, Vocabulary::read, own)? {
        Some(vocabulary) => vocabulary,
        None => Kinematic::default().build().map_err(|e| TaskError::values(ID, e))?,
    };
    let origin = Origin::new(&setup.device, parent);
    Ok(Box::new(NextToken { origin, ..NextToken::new(recipe, vocabulary, &setup.device) }))
}

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
                noise: Perturbation { wrong: 0.2, among: 6, remains: 0.5, slowed: 0.0 },
            },
            smoothing: Smoothing { uniform: 0.0, spatial: 0.1 },
        }
    }
}

/// The training task of next-token prediction.
pub struct NextToken {
    recipe: Recipe,
    vocabulary: Vocabulary,
    origin: Origin<Network>,
    /// Target distributions on the device with gradients and on the one without.
    target_distributions: [TargetDistributions; 2],
}

impl NextToken {
    /// Builds a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, vocabulary: Vocabulary, device: &Device) -> Self {
        let origin = Origin::new(device, None);
        let target_distributions =
            [true, false].map(|t| TargetDistributions::of(&vocabulary, &recipe.smoothing, &origin.device(t)));
        Self { recipe, vocabulary, origin, target_distributions }
    }

    /// Returns a network as the policy that a simulator reads.
    fn policy(&self, network: &Network) -> Policy {
        let (config, vocabulary) = (self.recipe.network, self.vocabulary.clone());
        Policy { config, vocabulary, network: network.clone() }
    }
}

impl Task for NextToken {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Network;

    fn init(&self, seed: u64) -> Network {
        let tokens = Class::ALL.map(|c| self.vocabulary.tokens(c));
        self.origin.network(seed, |init| Network::init(&self.recipe.network, tokens, init))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, mut stream: Option<&mut Stream>) -> Option<Sample> {
        let window = Window::of(scenario, stream.as_deref_mut());
        let (config, most) = (&self.recipe.network, self.recipe.agents);
        let map = KnownMap::of(&window.start, config.map_radius);
        let varied = stream.map(|stream| (&self.recipe.augmentation, stream));
        let scene = LearningScene::of(window, map);
        sample(scene, config, &self.vocabulary, most, varied)
    }

    fn loss(&self, model: &Network, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        let [of_training, of_validation] = &self.target_distributions;
        let distributions = if stream.is_some() { of_training } else { of_validation };
        loss(model, samples, distributions, &self.recipe.network, &self.origin.device(stream.is_some()))
    }

    fn file(&self, model: &Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        // Writing cannot fail: the vocabulary was read from text and files.
        self.policy(model).write(metadata).ok()
    }

    fn describe(&self) -> serde_json::Value {
        self.origin.describe(
            serde_json::json!({ "recipe": self.recipe, "vocabulary": self.vocabulary.provenance() }),
        )
    }
}

impl SimulatorTask for NextToken {
    fn controller(&self, network: &Network) -> Result<Controller, String> {
        let driving = REACTIVE.parameters().map_err(|e| e.to_string())?;
        let simulator = ReactiveSimulator::new(self.policy(network), driving, self.origin.device(false));
        Ok(Controller::Fair(Box::new(simulator)))
    }
}
