//! Training of the network as a task.

use std::collections::BTreeMap;

use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim_nn::learning::{
    Origin, ShippedRecipe, SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values,
};
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::entries::plain;
use super::super::network::Ctg;
use super::super::{CtgPolicy, CtgSimulator};
use super::loss::loss;
use super::sample::sample;
use super::{Recipe, Sample};
use crate::{Schedule, ScheduleError};

/// Training of CTG.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Diffusion over an agent's actions given an image around it, or cloning (CTG)",
    simulators: &["ctg-diffusion", "ctg-guided", "ctg-cloning"],
    defaults: || {
        let learner = Settings { learning_rate: 1e-3, warm_up: 100, ..Settings::default() };
        recipe_values(&Recipe::default(), &learner)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[ShippedRecipe {
        name: "cloning",
        about: "behaviour cloning by one linear layer, for `ctg-cloning`",
        text: include_str!("recipes/cloning.toml"),
    }],
    inputs: &[],
    needs_weights: false,
    make,
};

/// Id of the task.
const ID: &str = "ctg";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    recipe.network.check().map_err(|e| TaskError::values(ID, e))?;
    recipe.sight.check().map_err(|e| TaskError::values(ID, e))?;
    let new = CtgLearning::new(recipe, &setup.device).map_err(|e| TaskError::values(ID, e))?;
    let fits = |policy: &CtgPolicy| policy.config == recipe.network && policy.sight == recipe.sight;
    let parent = setup.parent(CtgPolicy::read, fits)?.map(|(policy, digest)| (policy.network, digest));
    Ok(Box::new(CtgLearning { origin: Origin::new(&setup.device, parent), ..new }))
}

/// The training task.
pub struct CtgLearning {
    recipe: Recipe,
    schedule: Schedule,
    origin: Origin<Ctg>,
}

impl CtgLearning {
    /// Creates a task on this device, which must be one without autodiff.
    ///
    /// # Errors
    /// [`ScheduleError`] if there are too few noise levels.
    pub fn new(recipe: Recipe, device: &Device) -> Result<Self, ScheduleError> {
        let schedule = Schedule::cosine(recipe.network.noise_levels)?;
        Ok(Self { recipe, schedule, origin: Origin::new(device, None) })
    }

    /// Returns a network as the policy that a simulator reads.
    pub fn policy(&self, network: &Ctg) -> CtgPolicy {
        let Recipe { network: config, sight, .. } = self.recipe;
        CtgPolicy { config, sight, network: network.clone() }
    }
}

impl Task for CtgLearning {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Ctg;

    fn init(&self, seed: u64) -> Ctg {
        self.origin.network(seed, |init| Ctg::init(&self.recipe.network, &self.recipe.sight, init))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, stream: Option<&mut Stream>) -> Option<Sample> {
        sample(scenario, &self.recipe, stream)
    }

    fn loss(&self, model: &Ctg, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        let device = self.origin.device(stream.is_some());
        // Validation has no stream: the same noise every time.
        let mut fixed = Stream::seed_from_u64(0);
        let stream = stream.unwrap_or(&mut fixed);
        loss(model, samples, &self.recipe, &self.schedule, stream, &device)
    }

    fn file(&self, model: &Ctg, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(model).write(metadata).ok()
    }

    fn describe(&self) -> serde_json::Value {
        self.origin.describe(serde_json::json!({ "recipe": self.recipe }))
    }
}

impl SimulatorTask for CtgLearning {
    fn controller(&self, network: &Ctg) -> Result<Controller, String> {
        let (id, parameters) = plain(self.recipe.network.decoding).map_err(|e| e.to_string())?;
        let policy = self.policy(network);
        Ok(Controller::Fair(Box::new(CtgSimulator::new(id, policy, parameters, self.origin.device(false)))))
    }
}
