//! Fine-tuning of the network as a task.

use burn::module::Module;
use burn::tensor::Tensor;
use rand::SeedableRng;
use reactsim_nn::learning::{TrainingTask, recipe_values};
use reactsim_nn::training::{Output, Settings, Stream, Sums};

use super::super::super::Smart;
use super::super::closed_loop::{AV, ClosedLoopSample, Excerpt};
use super::super::fine_tuning::{ClosedLoopRecipe, FineTuning};
use super::super::sample::forget_unseen_pieces;
use super::GrpoRecipe;
use super::rollout::{Rollout, choices, group};

/// Closed-loop fine-tuning of SMART and TrajTok by rewards.
pub const TASK: TrainingTask = TrainingTask {
    id: GrpoRecipe::ID,
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
    make: GroupRelative::make,
};

/// The fine-tuning task.
pub type GroupRelative = FineTuning<GrpoRecipe>;

impl GroupRelative {
    /// Drives every sample several times with a network without gradients.
    fn groups(
        &self,
        network: &Smart,
        samples: &[ClosedLoopSample],
        stream: &mut Stream,
    ) -> Vec<Vec<Rollout>> {
        let tables = self.tokens.tables(network);
        let drive = |sample| {
            let mut rollouts = group(network, &tables, sample, &self.recipe, &self.tokens.vocabulary, stream)
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
        let driven = if self.recipe.excerpt.external_av { AV + 1 } else { AV };
        for Rollout { outcome, .. } in groups.iter().flatten() {
            let rewards = outcome.returns.iter().skip(driven).filter_map(|returns| returns.first());
            sums.add("reward", rewards.sum(), 1.0);
            sums.add("av-contacts", outcome.av_contacts as f64, 1.0);
            sums.add("contacts", outcome.contacts as f64, 1.0);
        }
        sums
    }
}

impl ClosedLoopRecipe for GrpoRecipe {
    const ID: &'static str = "grpo";

    fn excerpt(&self) -> &Excerpt {
        &self.excerpt
    }

    /// In validation, the loss is the negative reward, by draws that are always the same.
    fn loss(
        tuning: &GroupRelative,
        model: &Smart,
        samples: &[ClosedLoopSample],
        stream: Option<&mut Stream>,
    ) -> Output {
        let Some(stream) = stream else {
            let metrics = tuning.summary(&tuning.groups(model, samples, &mut Stream::seed_from_u64(0)));
            let items = metrics.weight("reward");
            let loss = -metrics.mean("reward").unwrap_or(0.0) * items;
            return Output::new(Tensor::from_floats([loss as f32], &tuning.tokens.device), items, metrics);
        };
        let groups = tuning.groups(&model.valid(), samples, stream);
        let choices: Vec<_> = groups.iter().flat_map(|group| choices(group)).collect();
        let metrics = tuning.summary(&groups);
        let choices: Vec<_> = choices.iter().collect();
        let scenes: Vec<_> = groups.iter().flatten().map(|rollout| &rollout.scene).collect();
        let (reference, anchor) = (tuning.parent.valid(), tuning.recipe.anchor);
        let mut output = tuning.tokens.policy_loss(model, &reference, &scenes, &choices, anchor);
        output.metrics.extend(&metrics);
        output
    }
}
