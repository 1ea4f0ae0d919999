//! Recipe of a training.

use reactsim_nn::learning::SceneAugmentation;
use serde::{Deserialize, Serialize};

use super::super::PlannerSight;
use super::super::network::PlannerConfig;

/// Everything that determines training, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: PlannerConfig,
    /// Limits of its input.
    pub sight: PlannerSight,
    /// Number of noisy variants of a scene in one sample.
    pub draws: usize,
    /// Augmentation of scenes.
    #[serde(flatten)]
    pub augmentation: SceneAugmentation,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: PlannerConfig::default(),
            sight: PlannerSight::default(),
            draws: 4,
            augmentation: SceneAugmentation { shift: 4, mirror: 0.5, stretch: 0.1 },
        }
    }
}
