//! Training of the network as a task.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim_baseline::weights::PLANNER;
use reactsim_nn::learning::{
    Origin, SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values,
};
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::PlannerPolicy;
use super::super::network::DiffusionPlanner;
use super::loss::loss;
use super::sample::sample;
use super::{Recipe, Sample};

/// Training of Diffusion-Planner.
pub const TASK: TrainingTask = TrainingTask {
    id: PLANNER,
    also: &[],
    title: "Diffusion over the motion of the AV and its neighbours (Diffusion-Planner), a source of candidates",
    simulators: &[],
    defaults: || {
        let learner = Settings { learning_rate: 5e-4, warm_up: 200, ..Settings::default() };
        recipe_values(&Recipe::default(), &learner)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[],
    inputs: &[],
    needs_weights: false,
    make,
};

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    recipe.network.check().map_err(|e| TaskError::values(PLANNER, e))?;
    let fits = |policy: &PlannerPolicy| policy.config == recipe.network && policy.sight == recipe.sight;
    let parent = setup.parent(PlannerPolicy::read, fits)?.map(|(policy, digest)| (policy.network, digest));
    Ok(Box::new(Planning { recipe, origin: Origin::new(&setup.device, parent) }))
}

/// The training task.
pub struct Planning {
    recipe: Recipe,
    origin: Origin<DiffusionPlanner>,
}

impl Planning {
    /// Creates a task on this device, which must be one without autodiff.
    pub fn new(recipe: Recipe, device: &Device) -> Self {
        Self { recipe, origin: Origin::new(device, None) }
    }

    /// Returns a network as the policy that a source of candidates reads.
    pub fn policy(&self, network: &DiffusionPlanner) -> PlannerPolicy {
        let Recipe { network: config, sight, .. } = self.recipe;
        PlannerPolicy { config, sight, network: network.clone() }
    }
}

impl Task for Planning {
    type Example = Scenario;
    type Sample = Sample;
    type Model = DiffusionPlanner;

    fn init(&self, seed: u64) -> DiffusionPlanner {
        self.origin.network(seed, |init| DiffusionPlanner::init(&self.recipe.network, init))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, stream: Option<&mut Stream>) -> Option<Sample> {
        sample(scenario, &self.recipe, stream)
    }

    fn loss(&self, model: &DiffusionPlanner, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        let device = self.origin.device(stream.is_some());
        // Validation has no stream: the same noise every time.
        loss(model, samples, &self.recipe, stream.unwrap_or(&mut Stream::seed_from_u64(0)), &device)
    }

    fn file(&self, model: &DiffusionPlanner, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(model).write(metadata).ok()
    }

    fn describe(&self) -> serde_json::Value {
        let parameters = self.init(0).num_params();
        self.origin.describe(serde_json::json!({ "recipe": self.recipe, "parameters": parameters }))
    }
}

impl SimulatorTask for Planning {
    fn controller(&self, _network: &DiffusionPlanner) -> Result<Controller, String> {
        Err("this network plans for the AV: no simulator runs it".to_owned())
    }
}
