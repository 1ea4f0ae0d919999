//! Training of the network as a task.

use std::collections::BTreeMap;

use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim_nn::learning::{
    Intentions, Origin, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable, TrainingTask,
    recipe_values,
};
use reactsim_nn::training::{Output, Settings, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::entries::VBD;
use super::super::network::Vbd;
use super::super::{VbdPolicy, VbdSimulator};
use super::loss::{LossSettings, loss};
use super::sample::sample;
use super::{Recipe, Sample};
use crate::{Schedule, ScheduleError};

/// Training of VBD.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Diffusion over the joint actions of all agents (VBD)",
    simulators: &["vbd", "vbd-inpainting"],
    defaults: || {
        let learner = Settings { learning_rate: 5e-4, warm_up: 200, ..Settings::default() };
        recipe_values(&Recipe::default(), &learner)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[],
    inputs: &[TaskInput {
        name: ANCHORS,
        about: "points that agents may head for, from `train intentions` [default: a fan of sixteen]",
        required: false,
    }],
    needs_weights: false,
    make,
};

/// Id of the task.
const ID: &str = "vbd";
/// Name of the input with the anchors.
const ANCHORS: &str = "anchors";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: Recipe = setup.recipe()?;
    recipe.network.check().map_err(|e| TaskError::values(ID, e))?;
    let fits = |policy: &VbdPolicy| policy.config == recipe.network && policy.sight == recipe.sight;
    let parent = setup.parent(VbdPolicy::read, fits)?;
    let (parent, own) = parent.map(|(policy, digest)| ((policy.network, digest), policy.anchors)).unzip();
    let anchors = setup.input(ANCHORS, Intentions::read, own)?.unwrap_or_else(Intentions::fan);
    let origin = Origin::new(&setup.device, parent);
    let new = Denoising::new(recipe, anchors, &setup.device).map_err(|e| TaskError::values(ID, e))?;
    Ok(Box::new(Denoising { origin, ..new }))
}

/// The training task.
pub struct Denoising {
    recipe: Recipe,
    anchors: Intentions,
    schedule: Schedule,
    origin: Origin<Vbd>,
}

impl Denoising {
    /// Creates a task on this device, which must be one without autodiff.
    ///
    /// # Errors
    /// [`ScheduleError`] if there are too few noise levels.
    pub fn new(recipe: Recipe, anchors: Intentions, device: &Device) -> Result<Self, ScheduleError> {
        let schedule = Schedule::cosine(recipe.network.noise_levels)?;
        Ok(Self { recipe, anchors, schedule, origin: Origin::new(device, None) })
    }

    /// Returns a network as the policy that a simulator reads.
    pub fn policy(&self, network: &Vbd) -> VbdPolicy {
        let Recipe { network: config, sight, .. } = self.recipe;
        VbdPolicy { config, sight, anchors: self.anchors.clone(), network: network.clone() }
    }
}

impl Task for Denoising {
    type Example = Scenario;
    type Sample = Sample;
    type Model = Vbd;

    fn init(&self, seed: u64) -> Vbd {
        self.origin.network(seed, |init| Vbd::init(&self.recipe.network, init))
    }

    fn begins_trained(&self) -> bool {
        self.origin.is_trained()
    }

    fn prepare(&self, scenario: &Scenario, stream: Option<&mut Stream>) -> Option<Sample> {
        sample(scenario, &self.recipe, &self.anchors, stream)
    }

    fn loss(&self, model: &Vbd, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        let settings =
            LossSettings { recipe: &self.recipe, schedule: &self.schedule, anchors: &self.anchors };
        let device = self.origin.device(stream.is_some());
        // Validation has no stream: the same noise every time.
        loss(model, samples, &settings, stream.unwrap_or(&mut Stream::seed_from_u64(0)), &device)
    }

    fn file(&self, model: &Vbd, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(model).write(metadata).ok()
    }

    fn describe(&self) -> serde_json::Value {
        self.origin.describe(serde_json::json!({ "recipe": self.recipe, "anchors": self.anchors.describe() }))
    }
}

impl SimulatorTask for Denoising {
    fn controller(&self, network: &Vbd) -> Result<Controller, String> {
        let parameters = VBD.parameters().map_err(|e| e.to_string())?;
        let policy = self.policy(network);
        let simulator = VbdSimulator::new(VBD.id, policy, parameters, self.origin.device(false));
        Ok(Controller::Fair(Box::new(simulator)))
    }
}
