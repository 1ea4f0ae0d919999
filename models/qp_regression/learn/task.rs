//! The training task of the regression network.

use std::collections::BTreeMap;

use burn::tensor::Device;
use reactsim_learning::{
    Intentions, LearningScene, Origin, ShippedRecipe, SimulatorTask, TaskError, TaskInput, TaskSetup,
    Trainable, TrainingTask, recipe_values,
};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use reactsim_training::{Output, Settings, Stream, Sums, Task, View};
use serde::{Deserialize, Serialize};

use super::super::entries::regression_driving;
use super::super::inputs::Survey;
use super::super::network::{Config, Network, Observed};
use super::super::{Policy, RegressionSimulator};
use super::Disturbance;
use super::loss::{Losses, losses};
use super::measure::measure;
use super::sample::{Augmentation, Sample, sample};

/// Training of the regression network.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Motion prediction in the manner of MTR, 0.6 million weights by default",
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
    let intentions = setup.input(INTENTIONS, Intentions::read)?;
    let Some((policy, digest)) = setup.parent(Policy::read)? else {
        let intentions = intentions.unwrap_or_else(Intentions::fan);
        return Ok(Box::new(Regression::new(recipe, intentions, &setup.device)));
    };
    if policy.config != recipe.network {
        return Err(setup.refuse_parent_sizes());
    }
    if intentions.is_some_and(|other| other != policy.intentions) {
        return Err(setup.refuse_parent("it has other intention points than those given: omit them"));
    }
    let origin = Origin::Parent(policy.network, digest);
    Ok(Box::new(Regression { origin, ..Regression::new(recipe, policy.intentions, &setup.device) }))
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
    origin: Origin<Network>,
    /// Whether parked agents are judged too.
    parked: bool,
}

impl Regression {
    /// Creates a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, intentions: Intentions, device: &Device) -> Self {
        Self { recipe, intentions, device: device.clone(), origin: Origin::Random, parked: false }
    }

    /// Returns the same task with parked agents judged too. Training stays the same.
    pub fn with_parked(self) -> Self {
        Self { parked: true, ..self }
    }

    /// Returns a network as the policy that a simulator reads.
    pub fn policy(&self, network: &Network) -> Policy {
        Policy { config: self.recipe.network, intentions: self.intentions.clone(), network: network.clone() }
    }

    fn run(
        &self,
        model: &Network,
        samples: &[Sample],
        device: &Device,
        observed: Observed,
    ) -> (Losses, Sums) {
        let losses = losses(model, samples, &self.intentions, &self.recipe.network, device, observed);
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
        self.origin.network(seed, &self.device, |init| Network::init(&self.recipe.network, init))
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
        let (device, observed) = match stream {
            Some(_) => (self.device.clone().autodiff(), Observed::training()),
            None => (self.device.clone(), Observed::none()),
        };
        let (losses, metrics) = self.run(model, samples, &device, observed);
        Output { loss: losses.loss, items: losses.targets, metrics }
    }

    fn validate(&self, model: &Network, samples: &[Sample]) -> Output {
        let (losses, mut metrics) = self.run(model, samples, &self.device, Observed::none());
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
        self.origin
            .describe(serde_json::json!({ "recipe": self.recipe, "intentions": self.intentions.describe() }))
    }
}

impl SimulatorTask for Regression {
    fn controller(&self, network: &Network) -> Result<Controller, String> {
        let driving = regression_driving().map_err(|e| e.to_string())?;
        let simulator = RegressionSimulator::new(self.policy(network), driving, self.device.clone());
        Ok(Controller::Fair(Box::new(simulator)))
    }
}
