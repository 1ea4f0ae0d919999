//! Recipe of a training.

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
    /// Largest shift of the prediction frame from the current one, frames.
    pub shift: usize,
    /// Probability that a scene is mirrored.
    pub mirror: f64,
    /// Largest relative change of scale, up or down.
    pub stretch: f64,
}

impl Default for Recipe {
    fn default() -> Self {
        Self {
            network: PlannerConfig::default(),
            sight: PlannerSight::default(),
            draws: 4,
            shift: 4,
            mirror: 0.5,
            stretch: 0.1,
        }
    }
}
