//! Fine-tuning of the network as a task.

use burn::module::Module;
use burn::tensor::Device;
use reactsim_learning::{
    ShippedRecipe, SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values,
};
use reactsim_nn::Noise;
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use reactsim_training::{Output, Settings, Stream, Task, View};

use super::super::super::{InputError, Scene, Smart, SmartPolicy};
use super::super::Sample;
use super::super::closed_loop::{ClosedLoopSample, sample};
use super::super::fine_tuning::FineTuning;
use super::super::sample::forget_unseen_pieces;
use super::super::token_learning::TokenLearning;
use super::CatkRecipe;
use super::rollout::roll_out;

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
    let (parent, digest) = setup.parent(SmartPolicy::read)?.ok_or(TaskError::NoWeights { id: ID })?;
    Ok(Box::new(ClosestAmongTopK::new(recipe, parent, digest, &setup.device)))
}

/// The fine-tuning task.
pub struct ClosestAmongTopK {
    recipe: CatkRecipe,
    tuning: FineTuning,
}

impl ClosestAmongTopK {
    /// Builds a task on this device, which must be one without autodiff. The parent must be on the same with
    /// autodiff; `digest` names it.
    pub fn new(recipe: CatkRecipe, parent: SmartPolicy, digest: String, device: &Device) -> Self {
        let tuning = FineTuning::new(parent, digest, &recipe.smoothing, device);
        Self { recipe, tuning }
    }

    /// Rolls a sample out with a network without gradients: the history, then the steps that it drives.
    /// Without a stream, choices are without noise.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the sample.
    pub fn roll_out(
        &self,
        network: &Smart,
        sample: &ClosedLoopSample,
        stream: Option<&mut Stream>,
    ) -> Result<Scene, InputError> {
        let tables = self.tuning.tokens.tables(network);
        Ok(roll_out(network, &tables, sample, &self.recipe, &self.tuning.tokens.vocabulary, stream)?.scene)
    }

    /// Returns samples as a network without gradients drives in them.
    fn driven(
        &self,
        network: &Smart,
        samples: &[ClosedLoopSample],
        mut stream: Option<&mut Stream>,
    ) -> Vec<Sample> {
        let (tables, vocabulary) = (self.tuning.tokens.tables(network), &self.tuning.tokens.vocabulary);
        let drive = |sample| {
            let stream = stream.as_deref_mut();
            let mut driven = roll_out(network, &tables, sample, &self.recipe, vocabulary, stream)
                .expect("samples are made for networks of this configuration");
            forget_unseen_pieces(&mut driven.scene, network.config());
            driven
        };
        samples.iter().map(drive).collect()
    }
}

impl Task for ClosestAmongTopK {
    type Example = Scenario;
    type Sample = ClosedLoopSample;
    type Model = Smart;

    fn init(&self, _seed: u64) -> Smart {
        self.tuning.initial()
    }

    fn prepare(&self, scenario: &Scenario, view: View<'_>) -> Option<ClosedLoopSample> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tuning.tokens;
        sample(scenario, &self.recipe.excerpt(), vocabulary, map_vocabulary, view.stream())
    }

    fn loss(&self, model: &Smart, samples: &[ClosedLoopSample], stream: Option<&mut Stream>) -> Output {
        match stream {
            Some(stream) => {
                let driven = self.driven(&model.valid(), samples, Some(stream));
                self.tuning.tokens.loss(model, &driven, &mut Noise::none())
            }
            // Validation has no stream and no autodiff.
            None => self.tuning.tokens.plain_loss(model, &self.driven(model, samples, None)),
        }
    }

    fn file(&self, model: &Smart, about: &serde_json::Value) -> Option<Vec<u8>> {
        self.tuning.tokens.file(model, about)
    }

    fn describe(&self) -> serde_json::Value {
        self.tuning.describe(&self.recipe)
    }
}

impl SimulatorTask for ClosestAmongTopK {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tuning.tokens.controller(network)
    }
}
