//! Configuration of the network.

use serde::{Deserialize, Serialize};

/// Sizes, stored with the weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlannerConfig {
    /// Width of features.
    pub width: usize,
    /// Heads of every attention.
    pub heads: usize,
    /// Mixers of an element, and layers of the fusion.
    pub encoder_depth: usize,
    /// Layers of the transformer.
    pub decoder_depth: usize,
    /// Number of frames of the history, the current one last.
    pub history: usize,
    /// Number of neighbours in the input.
    pub agents: usize,
    /// Number of static objects in the input.
    pub statics: usize,
    /// Number of lanes in the input.
    pub lanes: usize,
    /// Number of lanes of the route.
    pub route: usize,
    /// Number of points of a lane.
    pub points: usize,
    /// Number of neighbours whose motion is predicted with that of the AV.
    pub predicted: usize,
    /// Number of predicted states.
    pub states: usize,
}

impl PlannerConfig {
    /// Returns the published sizes: 6.0 million parameters.
    pub const fn published() -> Self {
        Self {
            width: 192,
            heads: 6,
            encoder_depth: 3,
            decoder_depth: 3,
            history: 21,
            agents: 32,
            statics: 5,
            lanes: 70,
            route: 25,
            points: 20,
            predicted: 10,
            states: 80,
        }
    }

    /// Returns the number of elements of a scene.
    pub const fn elements(&self) -> usize {
        self.agents + self.statics + self.lanes
    }

    /// Returns the number of numbers of a trajectory: the current state and the predicted ones, x, y, cosine
    /// and sine of the heading each.
    pub const fn trajectory(&self) -> usize {
        4 * (1 + self.states)
    }
}
