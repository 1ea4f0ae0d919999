//! Fine-tuning of the network as a task.

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::SeedableRng;
use reactsim_learning::{SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use reactsim_training::{Output, Settings, Stream, Sums, Task, View};

use super::super::super::super::smoothing::Smoothing;
use super::super::super::{Smart, SmartPolicy};
use super::super::closed_loop::{AV, ClosedLoopSample, sample};
use super::super::fine_tuning::FineTuning;
use super::super::sample::forget_unseen_pieces;
use super::super::token_learning::TokenLearning;
use super::GrpoRecipe;
use super::rollout::{Rollout, choices, group};

/// Closed-loop fine-tuning of SMART and TrajTok by rewards.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Closed-loop fine-tuning of `smart` by group-relative policy gradients (GRPO)",
    simulators: &["smart", "smart-projected"],
    defaults: || {
        let learner = Settings { learning_rate: 2.5e-4, floor: 0.1, clip: 0.5, ..Settings::default() };
        recipe_values(&GrpoRecipe::default(), &learner)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[],
    inputs: &[],
    needs_weights: true,
    make,
};

/// Id of the task.
const ID: &str = "grpo";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let recipe: GrpoRecipe = setup.recipe()?;
    let (parent, digest) = setup.parent(SmartPolicy::read)?.ok_or(TaskError::NoWeights { id: ID })?;
    Ok(Box::new(GroupRelative::new(recipe, parent, digest, &setup.device)))
}

/// The fine-tuning task.
pub struct GroupRelative {
    recipe: GrpoRecipe,
    tuning: FineTuning,
    /// The network to start from, without autodiff.
    reference: Smart,
}

impl GroupRelative {
    /// Builds a task on this device, which must be one without autodiff. The parent must be on the same with
    /// autodiff; `digest` names it.
    pub fn new(recipe: GrpoRecipe, parent: SmartPolicy, digest: String, device: &Device) -> Self {
        let tuning = FineTuning::new(parent, digest, &Smoothing { uniform: 0.0, spatial: 0.0 }, device);
        Self { recipe, reference: tuning.reference(), tuning }
    }

    /// Drives every sample several times with a network without gradients.
    fn groups(
        &self,
        network: &Smart,
        samples: &[ClosedLoopSample],
        stream: &mut Stream,
    ) -> Vec<Vec<Rollout>> {
        let tables = self.tuning.tokens.tables(network);
        let drive = |sample| {
            let mut rollouts =
                group(network, &tables, sample, &self.recipe, &self.tuning.tokens.vocabulary, stream)
                    .expect("samples are made for networks of this configuration");
            for rollout in &mut rollouts {
                forget_unseen_pieces(&mut rollout.scene, network.config());
            }
            rollouts
        };
        samples.iter().map(drive).collect()
    }

    /// Returns the mean reward of driven agents from the first step on and the number of agents with
    /// contacts, per rollout, with the number of rollouts.
    fn summary(&self, groups: &[Vec<Rollout>]) -> Sums {
        let mut sums = Sums::new();
        let driven = if self.recipe.external_av { AV + 1 } else { AV };
        for Rollout { outcome, .. } in groups.iter().flatten() {
            let rewards = outcome.returns.iter().skip(driven).filter_map(|returns| returns.first());
            sums.add("reward", rewards.sum(), 1.0);
            sums.add("av-contacts", outcome.av_contacts as f64, 1.0);
            sums.add("contacts", outcome.contacts as f64, 1.0);
        }
        sums
    }
}

impl Task for GroupRelative {
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

    /// In validation, the loss is the negative reward, by draws that are always the same.
    fn loss(&self, model: &Smart, samples: &[ClosedLoopSample], stream: Option<&mut Stream>) -> Output {
        let Some(stream) = stream else {
            let groups = self.groups(model, samples, &mut Stream::seed_from_u64(0));
            let metrics = self.summary(&groups);
            let items = metrics.weight("reward");
            let loss = -metrics.mean("reward").unwrap_or(0.0) * items;
            let loss = Tensor::from_floats([loss as f32], &self.tuning.tokens.device);
            return Output::new(loss, items, metrics);
        };
        let groups = self.groups(&model.valid(), samples, stream);
        let choices: Vec<_> = groups.iter().flat_map(|group| choices(group)).collect();
        let metrics = self.summary(&groups);
        let scenes: Vec<_> = groups.into_iter().flatten().map(|rollout| rollout.scene).collect();
        let mut output =
            self.tuning.tokens.policy_loss(model, &self.reference, &scenes, &choices, self.recipe.anchor);
        output.metrics.extend(&metrics);
        output
    }

    fn file(&self, model: &Smart, about: &serde_json::Value) -> Option<Vec<u8>> {
        self.tuning.tokens.file(model, about)
    }

    fn describe(&self) -> serde_json::Value {
        self.tuning.describe(&self.recipe)
    }
}

impl SimulatorTask for GroupRelative {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tuning.tokens.controller(network)
    }
}
