//! Settings of a training: those that determine the result, and those of its execution.

use std::time::Duration;

use serde::{Deserialize, Serialize};

/// Settings that, together with the task and the data, determine the result.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Seed of all random choices.
    #[serde(default)]
    pub seed: u64,
    /// Number of epochs.
    pub epochs: f64,
    /// Examples per step.
    pub batch: usize,
    /// Examples per forward pass; a batch is split into parts of this size, which threads share.
    pub together: usize,
    /// Peak learning rate.
    pub learning_rate: f64,
    /// Final learning rate as a fraction of the peak.
    pub floor: f64,
    /// Number of warm-up steps, in which the learning rate grows from 0.
    pub warm_up: u64,
    /// Weight decay of matrices, per step and unit of learning rate.
    pub weight_decay: f64,
    /// Decay rate of the first moment.
    pub beta1: f64,
    /// Decay rate of the second moment.
    pub beta2: f64,
    /// Constant added to the square root of the second moment.
    pub epsilon: f64,
    /// Norm to which larger gradients are clipped.
    pub clip: f64,
    /// Steps between validations.
    pub validate_every: u64,
    /// Fraction of the examples held out for validation, by a hash of the name.
    pub held_out: f64,
    /// Maximum number of examples per validation; further held-out examples are not used at all.
    pub most_held_out: usize,
    /// Number of validations without a better network after which the training ends; 0: never.
    pub patience: u64,
    /// Value by which the best network is chosen, the lowest one: [`LOSS`], or a metric of the closed-loop
    /// evaluation.
    pub best_by: String,
}

/// Value of [`Settings::best_by`] that stands for the validation loss.
pub const LOSS: &str = "loss";

impl Default for Settings {
    /// Values for networks of about a million parameters. Betas and epsilon are those of Loshchilov and
    /// Hutter, "Decoupled Weight Decay Regularization", <https://arxiv.org/abs/1711.05101>.
    fn default() -> Self {
        Self {
            seed: 0,
            epochs: 10.0,
            batch: 8,
            together: 1,
            learning_rate: 1e-3,
            floor: 0.01,
            warm_up: 0,
            weight_decay: 0.01,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-8,
            clip: 1.0,
            validate_every: 200,
            held_out: 0.02,
            most_held_out: 128,
            patience: 0,
            best_by: LOSS.to_owned(),
        }
    }
}

impl Settings {
    /// Returns a message about the first invalid setting.
    pub(super) fn refuse(&self) -> Option<String> {
        let not =
            |name: &str, value: f64, expected: &str| Some(format!("{name} is {value}, expected {expected}"));
        if !(self.epochs > 0.0 && self.epochs <= 1e6) {
            return not("epochs", self.epochs, "more than 0, at most 1000000");
        }
        for (name, value) in [("batch", self.batch), ("together", self.together)] {
            if value == 0 || value > 65_536 {
                return not(name, value as f64, "1 to 65536");
            }
        }
        if self.validate_every == 0 {
            return not("validate_every", 0.0, "at least 1");
        }
        for (name, value) in
            [("learning_rate", self.learning_rate), ("clip", self.clip), ("epsilon", self.epsilon)]
        {
            if !(value > 0.0 && value.is_finite()) {
                return not(name, value, "more than 0 and finite");
            }
        }
        for (name, value) in
            [("floor", self.floor), ("weight_decay", self.weight_decay), ("held_out", self.held_out)]
        {
            if !(0.0..=1.0).contains(&value) {
                return not(name, value, "0 to 1");
            }
        }
        let betas = [("beta1", self.beta1), ("beta2", self.beta2)];
        let beta = betas.into_iter().find(|(_, b)| !(0.0..1.0).contains(b));
        beta.and_then(|(name, b)| not(name, b, "0 to below 1"))
    }
}

/// Settings of the execution, which do not change the result.
#[derive(Clone, Copy, Debug)]
pub struct Execution {
    /// Number of threads.
    pub jobs: usize,
    /// Time between checkpoints.
    pub checkpoint_every: Duration,
    /// Steps between networks that are kept ([`kept_weights`](super::kept_weights)); 0: none but the best.
    pub keep_every: u64,
}
