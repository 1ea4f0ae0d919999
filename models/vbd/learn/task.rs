//! Training of the network as a task.

use std::collections::BTreeMap;

use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim_diffusion::{Schedule, ScheduleError};
use reactsim_learning::{
    Intentions, Origin, SimulatorTask, TaskError, TaskInput, TaskSetup, Trainable, TrainingTask,
    recipe_values,
};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use reactsim_training::{Output, Settings, Stream, Task, View};

use super::super::entries::parameters;
use super::super::network::Vbd;
use super::super::{VbdPolicy, VbdSimulator};
use super::loss::{LossSettings, loss};
use super::sample::sample;
use super::{Recipe, Sample};

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
    let given = setup.input(ANCHORS, Intentions::read)?;
    let refuse = |e| TaskError::values(ID, e);
    let Some((parent, digest)) = setup.parent(VbdPolicy::read)? else {
        let anchors = given.unwrap_or_else(Intentions::fan);
        return Ok(Box::new(Denoising::new(recipe, anchors, &setup.device).map_err(refuse)?));
    };
    if parent.config != recipe.network || parent.sight != recipe.sight {
        return Err(setup.refuse_parent_sizes());
    }
    if given.is_some_and(|other| other != parent.anchors) {
        return Err(setup.refuse_parent("it has other anchors than those given: omit them"));
    }
    let origin = Origin::Parent(parent.network, digest);
    Ok(Box::new(Denoising {
        origin,
        ..Denoising::new(recipe, parent.anchors, &setup.device).map_err(refuse)?
    }))
}

/// The training task.
pub struct Denoising {
    recipe: Recipe,
    anchors: Intentions,
    schedule: Schedule,
    device: Device,
    origin: Origin<Vbd>,
}

impl Denoising {
    /// Creates a task on this device, which must be one without autodiff.
    ///
    /// # Errors
    /// [`ScheduleError`] if there are too few noise levels.
    pub fn new(recipe: Recipe, anchors: Intentions, device: &Device) -> Result<Self, ScheduleError> {
        let schedule = Schedule::cosine(recipe.network.noise_levels)?;
        Ok(Self { recipe, anchors, schedule, device: device.clone(), origin: Origin::Random })
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
        self.origin.network(seed, &self.device, |init| Vbd::init(&self.recipe.network, init))
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<Sample> {
        sample(scenario, &self.recipe, &self.anchors, view.stream())
    }

    fn loss(&self, model: &Vbd, samples: &[Sample], stream: Option<&mut Stream>) -> Output {
        let settings = LossSettings {
            config: &self.recipe.network,
            schedule: &self.schedule,
            anchors: &self.anchors,
            predictor: self.recipe.predictor,
            predicted: self.recipe.predicted,
            avoid: self.recipe.avoid,
        };
        match stream {
            Some(stream) => loss(model, samples, &settings, stream, &self.device.clone().autodiff()),
            // Validation has no stream and no autodiff: the same noise every time.
            None => loss(model, samples, &settings, &mut Stream::seed_from_u64(0), &self.device),
        }
    }

    fn file(&self, model: &Vbd, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        self.policy(model).write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        self.origin.describe(serde_json::json!({ "recipe": self.recipe, "anchors": self.anchors.describe() }))
    }
}

impl SimulatorTask for Denoising {
    fn controller(&self, network: &Vbd) -> Result<Controller, String> {
        let parameters = parameters().map_err(|e| e.to_string())?;
        let policy = self.policy(network);
        Ok(Controller::Fair(Box::new(VbdSimulator::new("vbd", policy, parameters, self.device.clone()))))
    }
}
