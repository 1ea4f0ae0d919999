//! Configuration of the network.

use reactsim_nn::SizeError;
use reactsim_scene::FUTURE;
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

impl Default for PlannerConfig {
    /// Returns sizes for training on two processor cores. There is no route, but the network has a place for one.
    fn default() -> Self {
        Self {
            width: 80,
            heads: 4,
            encoder_depth: 2,
            decoder_depth: 2,
            history: 11,
            agents: 16,
            statics: 5,
            lanes: 32,
            route: 1,
            points: 10,
            predicted: 10,
            states: 16,
        }
    }
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

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`SizeError`], which names the field.
    pub fn check(&self) -> Result<(), SizeError> {
        let refuse = |field, value: usize, expected| Err(SizeError { field, value: value as f64, expected });
        let sizes = [
            ("width", self.width),
            ("heads", self.heads),
            ("encoder_depth", self.encoder_depth),
            ("decoder_depth", self.decoder_depth),
            ("history", self.history),
            ("agents", self.agents),
            ("statics", self.statics),
            ("lanes", self.lanes),
            ("route", self.route),
            ("points", self.points),
            ("predicted", self.predicted),
        ];
        for (field, value) in sizes {
            if !(1..=4096).contains(&value) {
                return refuse(field, value, "1 to 4096");
            }
        }
        if !self.width.is_multiple_of(self.heads) {
            return refuse("width", self.width, "a multiple of the number of heads");
        }
        if self.points < 2 {
            return refuse("points", self.points, "2 or more");
        }
        if self.predicted >= self.agents {
            return refuse("predicted", self.predicted, "fewer than the agents of the input");
        }
        if self.states == 0 || !FUTURE.is_multiple_of(self.states) {
            return refuse("states", self.states, "a divisor of 80");
        }
        Ok(())
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
