//! Fine-tuning of the network as a task.

use std::collections::BTreeMap;
use std::error::Error;

use burn::module::Module;
use burn::tensor::Device;
use reactsim::models::nn::Noise;
use reactsim::rollout::Controller;
use reactsim::scene::Scenario;
use reactsim::training::{Output, Settings, Stream, Task, View};

use super::super::super::super::entries::smart_parameters;
use super::super::super::super::smoothing::TargetDistributions;
use super::super::super::super::token_loss::{Target, token_loss};
use super::super::super::{Batch, InputError, Scene, Smart, SmartPolicy, SmartSimulator, token_shapes};
use super::super::sample::forget_unseen_pieces;
use super::rollout::roll_out;
use super::sample::sample;
use super::{CatkRecipe, CatkSample};
use crate::models::learning::{
    ShippedRecipe, SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values,
};

/// Closed-loop fine-tuning of SMART and TrajTok.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Closed-loop fine-tuning of `smart`: closest among the top K (CATK)",
    simulators: &["smart", "smart-projected"],
    defaults: || {
        // Learning rate, final rate and clipping are the published ones.
        let published = Settings { learning_rate: 5e-5, floor: 0.05, clip: 0.5, ..Settings::default() };
        recipe_values(&CatkRecipe::default(), &published)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[ShippedRecipe {
        name: "reactive",
        about: "for scenarios whose AV leaves its log and whose agents react to it",
        text: include_str!("recipes/reactive.toml"),
    }],
    inputs: &[],
    needs_weights: true,
    make,
};

/// Id of the task.
const ID: &str = "catk";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: CatkRecipe = setup.recipe()?;
    let file = setup.from.as_ref().ok_or(TaskError::NoWeights { id: ID })?;
    let refuse = |source: Box<dyn Error + Send + Sync>| TaskError::File {
        what: "weights",
        file: file.name.clone(),
        source,
    };
    let parent =
        SmartPolicy::read(&file.bytes, &setup.device.clone().autodiff()).map_err(|e| refuse(e.into()))?;
    Ok(Box::new(ClosestAmongTopK::new(recipe, parent, file.digest.clone(), &setup.device)))
}

/// The fine-tuning task.
pub struct ClosestAmongTopK {
    recipe: CatkRecipe,
    /// The network to start from, on a device with autodiff, with its vocabularies.
    parent: SmartPolicy,
    /// Digest of its file.
    digest: String,
    device: Device,
    /// Target distributions on the device with gradients and on the one without.
    distributions: [TargetDistributions; 2],
}

impl ClosestAmongTopK {
    /// Builds a task on this device, which must be one without autodiff. The parent must be on the same with
    /// autodiff; `digest` names it.
    pub fn new(recipe: CatkRecipe, parent: SmartPolicy, digest: String, device: &Device) -> Self {
        let device = device.clone();
        let distributions = [device.clone().autodiff(), device.clone()]
            .map(|d| TargetDistributions::of(&parent.vocabulary, &recipe.smoothing, &d));
        Self { recipe, parent, digest, device, distributions }
    }

    /// Rolls a sample out with a network without gradients: the history, then the steps that it drives.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the sample.
    pub fn roll_out(&self, network: &Smart, sample: &CatkSample) -> Result<Scene, InputError> {
        let SmartPolicy { vocabulary, map_vocabulary, .. } = &self.parent;
        let tables = network.tables(&token_shapes(vocabulary, map_vocabulary), &self.device)?;
        Ok(roll_out(network, &tables, sample, &self.recipe, vocabulary)?.0)
    }

    /// Rolls samples out with the network without gradients, and returns the loss of the network on this device
    /// in the states that were reached.
    fn run(
        &self,
        driving: &Smart,
        network: &Smart,
        samples: &[CatkSample],
        distributions: &TargetDistributions,
        device: &Device,
    ) -> Output {
        const READ: &str = "samples are made for networks of this configuration";
        let SmartPolicy { vocabulary, map_vocabulary, .. } = &self.parent;
        let shapes = token_shapes(vocabulary, map_vocabulary);
        let tables = driving.tables(&shapes, &self.device).expect(READ);
        let (mut scenes, mut targets, mut nodes) = (Vec::new(), Vec::new(), 0);
        for sample in samples {
            let (mut scene, own) = roll_out(driving, &tables, sample, &self.recipe, vocabulary).expect(READ);
            targets.extend(own.into_iter().map(|t| Target { row: t.row + nodes, ..t }));
            nodes += scene.agents.len() * scene.steps.len();
            forget_unseen_pieces(&mut scene, network.config());
            scenes.push(scene);
        }
        let batch = Batch::new(network.config(), &scenes, &mut Noise::none()).expect(READ);
        let tables = network.tables(&shapes, device).expect(READ);
        let scores = network.forward(&tables, &batch, &mut Noise::none());
        token_loss(&targets, distributions, device, |class, rows| {
            scores.clone().select(0, rows).narrow(1, 0, vocabulary.tokens(class))
        })
    }

    fn policy(&self, network: &Smart) -> Result<SmartPolicy, String> {
        let SmartPolicy { vocabulary, map_vocabulary, .. } = &self.parent;
        SmartPolicy::new(network.clone(), vocabulary.clone(), map_vocabulary.clone(), &self.device)
            .map_err(|e| e.to_string())
    }
}

impl Task for ClosestAmongTopK {
    type Example = Scenario;
    type Sample = CatkSample;
    type Model = Smart;

    fn init(&self, _seed: u64) -> Smart {
        self.parent.network.clone().with_frozen_embeddings()
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<CatkSample> {
        let varied = match view {
            View::Varied(stream) => Some(stream),
            View::Plain => None,
        };
        let SmartPolicy { vocabulary, map_vocabulary, .. } = &self.parent;
        sample(scenario, &self.recipe, vocabulary, map_vocabulary, varied)
    }

    fn loss(&self, model: &Smart, samples: &[CatkSample], stream: Option<&mut Stream>) -> Output {
        match stream {
            Some(_) => {
                let (driving, device) = (model.valid(), self.device.clone().autodiff());
                self.run(&driving, model, samples, &self.distributions[0], &device)
            }
            // Validation has no stream and no autodiff.
            None => self.run(model, model, samples, &self.distributions[1], &self.device),
        }
    }

    fn file(&self, model: &Smart, about: &serde_json::Value) -> Option<Vec<u8>> {
        let made = BTreeMap::from([("made".to_owned(), about.to_string())]);
        self.policy(model).ok()?.write(&made).ok()
    }

    fn describe(&self) -> serde_json::Value {
        serde_json::json!({
            "recipe": self.recipe,
            "from": self.digest,
            "parameters": self.parent.network.num_params(),
        })
    }
}

impl SimulatorTask for ClosestAmongTopK {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        let parameters = smart_parameters().map_err(|e| e.to_string())?;
        Ok(Controller::Fair(Box::new(SmartSimulator::new("smart", self.policy(network)?, parameters))))
    }
}
