//! Recipe of a training.

use reactsim_nn::learning::SceneAugmentation;
use serde::{Deserialize, Serialize};

use super::super::Sight;
use super::super::network::CtgConfig;

/// Everything that determines training, besides the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Sizes of the network.
    pub network: CtgConfig,
    /// Limits of its input.
    pub sight: Sight,
    /// Number of agents per scenario: those that move, nearest to the AV first, then parked ones.
    pub agents: usize,
    /// Weight of parked agents; that of others is 1.
    pub parked: f64,
    /// Weight of the squared yaw rate in the loss of behaviour cloning.
    pub turning: f64,
    /// Augmentation of scenes.
    #[serde(flatten)]
    pub augmentation: SceneAugmentation,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: CtgConfig::default(),
            sight: Sight::default(),
            agents: 8,
            parked: 0.1,
            turning: 0.1,
            augmentation: SceneAugmentation { shift: 4, mirror: 0.5, stretch: 0.1 },
        }
    }
}
