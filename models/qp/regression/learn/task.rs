//! The training task of the regression network.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_nn::learning::{
    Intentions, LearningScene, Origin, SceneAugmentation, ShippedRecipe, SimulatorTask, TaskError, TaskInput,
    TaskSetup, Trainable, TrainingTask, Window, recipe_values,
};
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use serde::{Deserialize, Serialize};

use super::super::entries::REGRESSION;
use super::super::inputs::Survey;
use super::super::network::{Config, LayerOutput, Network};
use super::super::{Policy, RegressionSimulator};
use super::Disturbance;
use super::loss::loss;
use super::measure::measure;
use super::sample::{Augmentation, Sample, sample};

/// Training of the regression network.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Motion prediction in the manner of MTR, 0.4 million weights by default",
    simulators: &[ID, "regression"],
    defaults: || recipe_values(&Recipe::default(), &Settings::default()),
    ranges: include_str!("ranges.toml"),
    recipes: &[ShippedRecipe {
        name: "mtr",
        about: "the published structure, without the lane outlook",
        text: include_str!("recipes/mtr.toml"),
    }],
    inputs: &[TaskInput {
        name: INTENTIONS,
        about: "intention points, from `train intentions` [default: a fan of sixteen]",
        required: false,
    }],
    needs_weights: false,
    make,
};

/// Id of the task, and of the simulator that plans along predictions.
const ID: &str = "qp-regression";
/// Name of the input with the intention points.
const INTENTIONS: &str = "intentions";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    recipe.network.check().map_err(|e| TaskError::values(ID, e))?;
    let parent = setup.parent(Policy::read, |policy| policy.config.holds(&recipe.network))?;
    let layers = recipe.network.decoder_layers;
    let parent = parent
        .map(|(policy, digest)| ((policy.network.with_decoder_layers(layers), digest), policy.intentions));
    let (parent, own) = parent.unzip();
    let intentions = setup.input(INTENTIONS, Intentions::read, own)?.unwrap_or_else(Intentions::fan);
    let origin = Origin::new(&setup.device, parent);
    Ok(Box::new(Regression { origin, ..Regression::new(recipe, intentions, &setup.device) }))
}

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
                scene: SceneAugmentation { shift: 4, mirror: 0.5, stretch: 0.1 },
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
    origin: Origin<Network>,
    /// Whether parked agents are judged too.
    parked: bool,
}

impl Regression {
    /// Creates a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, intentions: Intentions, device: &Device) -> Self {
        Self { recipe, intentions, origin: Origin::new(device, None), parked: false }
    }

    /// Returns the same task with parked agents judged too. Training stays the same.
    pub fn with_parked(self) -> Self {
        Self { parked: true, ..self }
    }

    /// Returns a network as the policy that a simulator reads.
    pub fn policy(&self, network: &Network) -> Policy {
        Policy { config: self.recipe.network, intentions: self.intentions.clone(), network: network.clone() }
    }

    fn run(&self, model: &Network, samples: &[Sample], training: bool) -> (Output, Option<LayerOutput>) {
        let device = self.origin.device(training);
        loss(model, samples, &self.intentions, &self.recipe.network, &device, training)
    }
}

impl Task for Regression {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Network;

    fn init(&self, seed: u64) -> Network {
        self.origin.network(seed, |init| Network::init(&self.recipe.network, init))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, mut stream: Option<&mut Stream>) -> Option<Sample> {
        let (config, most) = (&self.recipe.network, self.recipe.agents);
        let window = Window::of(scenario, stream.as_deref_mut());
        let survey = Survey::of(&window.start, config);
        let parked = self.parked && stream.is_none();
        let varied = stream.map(|stream| (&self.recipe.augmentation, stream));
        sample(LearningScene::of(window, survey), config, most, varied, parked)
    }

    fn loss(&self, model: &Network, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        self.run(model, samples, stream.is_some()).0
    }

    fn validate(&self, model: &Network, samples: &[Sample]) -> Output {
        let (mut output, last) = self.run(model, samples, false);
        if let Some(last) = last {
            measure(samples, last, &self.recipe.network, &mut output.metrics);
        }
        output
    }

    fn file(&self, model: &Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        // The provenance of the intention points was read from text, or made here: it can be written.
        self.policy(model).write(metadata).ok()
    }

    fn describe(&self) -> serde_json::Value {
        self.origin
            .describe(serde_json::json!({ "recipe": self.recipe, "intentions": self.intentions.describe() }))
    }
}

impl SimulatorTask for Regression {
    fn controller(&self, network: &Network) -> Result<Controller, String> {
        let driving = REGRESSION.parameters().map_err(|e| e.to_string())?;
        let simulator = RegressionSimulator::new(self.policy(network), driving, self.origin.device(false));
        Ok(Controller::Fair(Box::new(simulator)))
    }
}
