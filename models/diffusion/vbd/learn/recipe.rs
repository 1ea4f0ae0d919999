//! Recipe of a training.

use reactsim_nn::learning::SceneAugmentation;
use serde::{Deserialize, Serialize};

use super::super::Sight;
use super::super::network::VbdConfig;

/// Everything that determines training, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: VbdConfig,
    /// Limits of its input.
    pub sight: Sight,
    /// Weight of the behaviour predictor in the loss.
    pub predictor: f64,
    /// Share of scenes in which the behaviour predictor learns. It takes most of the time of a step.
    pub predicted: f64,
    /// Weight of overlaps with the AV, m, in the motion that denoised actions lead to.
    pub avoid: f64,
    /// Distance to the AV, metres, at which an agent has half the weight of one that is next to it.
    pub near: f64,
    /// Weight of parked agents; that of others is 1.
    pub parked: f64,
    /// Augmentation of scenes.
    #[serde(flatten)]
    pub augmentation: SceneAugmentation,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: VbdConfig::default(),
            sight: Sight::default(),
            predictor: 1.0,
            predicted: 0.25,
            avoid: 30.0,
            near: 25.0,
            parked: 0.1,
            augmentation: SceneAugmentation { shift: 4, mirror: 0.5, stretch: 0.1 },
        }
    }
}
