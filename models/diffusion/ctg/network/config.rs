//! Configuration of the network.

use reactsim_nn::SizeError;
use reactsim_scene::FUTURE;
use serde::{Deserialize, Serialize};

/// How the network finds actions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Decoding {
    /// By one linear layer: behaviour cloning.
    Cloning,
    /// By denoising.
    Diffusion,
}

/// Sizes, stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CtgConfig {
    /// How actions are found.
    pub decoding: Decoding,
    /// Width of the encoder; its four stages, each of which halves the image, have 1, 2, 4 and 6 times as
    /// much.
    pub image_width: usize,
    /// Width of the features of an image.
    pub features: usize,
    /// Width of the denoiser; its three levels have 2, 4 and 8 times as much.
    pub width: usize,
    /// Number of actions of a plan; a multiple of 4.
    pub actions: usize,
    /// Number of steps of 0.1 s for which an action is held.
    pub hold: usize,
    /// Number of noise levels.
    pub noise_levels: usize,
}

impl Default for CtgConfig {
    /// Returns a configuration for training on two processor cores.
    fn default() -> Self {
        Self {
            decoding: Decoding::Diffusion,
            image_width: 16,
            features: 128,
            width: 8,
            actions: 20,
            hold: 2,
            noise_levels: 20,
        }
    }
}

impl CtgConfig {
    /// Returns the number of steps of 0.1 s of a plan.
    pub const fn states(&self) -> usize {
        self.actions * self.hold
    }

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub fn check(&self) -> Result<(), SizeError> {
        let refuse = |field, value: usize, expected| Err(SizeError { field, value: value as f64, expected });
        for (field, value) in [("image_width", self.image_width), ("width", self.width)] {
            if !(1..=512).contains(&value) {
                return refuse(field, value, "1 to 512");
            }
        }
        if !(2..=4096).contains(&self.features) {
            return refuse("features", self.features, "2 to 4096");
        }
        if self.actions == 0 || !self.actions.is_multiple_of(4) {
            return refuse("actions", self.actions, "a multiple of 4, which the levels halve twice");
        }
        if self.hold == 0 || self.actions.saturating_mul(self.hold) > FUTURE {
            return refuse("hold", self.hold, "1 or more, and at most 80 steps by all actions");
        }
        if !(2..=4096).contains(&self.noise_levels) {
            return refuse("noise_levels", self.noise_levels, "2 to 4096");
        }
        Ok(())
    }
}
