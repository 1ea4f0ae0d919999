//! Recipe of a training.

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
            network: VbdConfig::default(),
            sight: Sight::default(),
            predictor: 1.0,
            predicted: 0.25,
            avoid: 30.0,
            near: 25.0,
            parked: 0.1,
            shift: 4,
            mirror: 0.5,
            stretch: 0.1,
        }
    }
}
