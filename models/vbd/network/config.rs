//! Configuration of the network.

use serde::{Deserialize, Serialize};

/// Sizes, stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VbdConfig {
    /// Width of features.
    pub width: usize,
    /// Hidden width of the perceptrons that read agents, points, anchors and states.
    pub hidden: usize,
    /// Heads of every attention.
    pub heads: usize,
    /// Frequencies per number of a relation.
    pub frequencies: usize,
    /// Layers of the scene encoder.
    pub encoder_layers: usize,
    /// Pairs of blocks of the predictor, and of the denoiser.
    pub pairs: usize,
    /// Number of actions of a plan.
    pub actions: usize,
    /// Number of steps of 0.1 s for which an action is held.
    pub hold: usize,
    /// Number of noise levels.
    pub noise_levels: usize,
    /// Whether the encoder attends to present elements alone. The public code attends to all of them, and from absent
    /// ones to all alike.
    pub masked: bool,
}

impl VbdConfig {
    /// Returns the published sizes: 11.8 million parameters.
    pub const fn published() -> Self {
        Self {
            width: 256,
            hidden: 128,
            heads: 8,
            frequencies: 64,
            encoder_layers: 6,
            pairs: 2,
            actions: 40,
            hold: 2,
            noise_levels: 50,
            masked: false,
        }
    }

    /// Returns the number of predicted states of an agent.
    pub const fn states(&self) -> usize {
        self.actions * self.hold
    }
}
