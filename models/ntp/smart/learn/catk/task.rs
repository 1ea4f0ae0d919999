//! Fine-tuning of the network as a task.

use burn::module::Module;
use reactsim_nn::Noise;
use reactsim_nn::learning::{ShippedRecipe, TrainingTask, recipe_values};
use reactsim_nn::training::{Output, Settings, Stream};

use super::super::super::super::smoothing::Smoothing;
use super::super::super::{InputError, Scene, Smart};
use super::super::Sample;
use super::super::closed_loop::{ClosedLoopSample, Excerpt};
use super::super::fine_tuning::{ClosedLoopRecipe, FineTuning};
use super::super::sample::forget_unseen_pieces;
use super::CatkRecipe;
use super::rollout::roll_out;

/// Closed-loop fine-tuning of SMART and TrajTok.
pub const TASK: TrainingTask = TrainingTask {
    id: CatkRecipe::ID,
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
    make: ClosestAmongTopK::make,
};

/// The fine-tuning task.
pub type ClosestAmongTopK = FineTuning<CatkRecipe>;

impl ClosestAmongTopK {
    /// Rolls a sample out with a network without gradients: the history, then the steps that it drives.
    ///
    /// # Errors
    /// [`InputError`] if the network cannot read the sample.
    pub fn roll_out(&self, network: &Smart, sample: &ClosedLoopSample) -> Result<Scene, InputError> {
        let tables = self.tokens.tables(network);
        Ok(roll_out(network, &tables, sample, &self.recipe, &self.tokens.vocabulary)?.scene)
    }

    /// Returns samples as a network without gradients drives in them.
    fn driven(&self, network: &Smart, samples: &[ClosedLoopSample]) -> Vec<Sample> {
        let (tables, vocabulary) = (self.tokens.tables(network), &self.tokens.vocabulary);
        let drive = |sample| {
            let mut driven = roll_out(network, &tables, sample, &self.recipe, vocabulary)
                .expect("samples are made for networks of this configuration");
            forget_unseen_pieces(&mut driven.scene, network.config());
            driven
        };
        samples.iter().map(drive).collect()
    }
}

impl ClosedLoopRecipe for CatkRecipe {
    const ID: &'static str = "catk";

    fn excerpt(&self) -> &Excerpt {
        &self.excerpt
    }

    fn smoothing(&self) -> Smoothing {
        self.smoothing
    }

    fn loss(
        tuning: &ClosestAmongTopK,
        model: &Smart,
        samples: &[ClosedLoopSample],
        stream: Option<&mut Stream>,
    ) -> Output {
        match stream {
            Some(_) => {
                let driven = tuning.driven(&model.valid(), samples);
                tuning.tokens.loss(model, &driven, &mut Noise::none())
            }
            None => tuning.tokens.plain_loss(model, &tuning.driven(model, samples)),
        }
    }
}
