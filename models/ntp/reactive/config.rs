//! Sizes of the reactive network.

use reactsim_nn::WeightsError;
use serde::{Deserialize, Serialize};

/// Sizes and ranges of the reactive network. Stored with its weights.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// Width of node features.
    pub hidden: usize,
    /// Number of attention heads.
    pub heads: usize,
    /// Width of a head.
    pub head_width: usize,
    /// Width of an embedded relation.
    pub relation: usize,
    /// Hidden width of the feed-forward layers.
    pub feed_forward: usize,
    /// Hidden width of the token heads.
    pub head_hidden: usize,
    /// Number of attention layers of the map.
    pub map_layers: usize,
    /// Number of agent layers; each attends to the agent's past, to the map and to other agents.
    pub agent_layers: usize,
    /// Number of neighbours of a map place.
    pub map_neighbours: usize,
    /// Number of map pieces nearest to an agent that it attends to.
    pub near_pieces: usize,
    /// Number of lane pieces nearest to a point ahead of an agent that it attends to.
    pub ahead_pieces: usize,
    /// Number of stops ahead that an agent attends to.
    pub stops: usize,
    /// Number of nearest agents that an agent attends to; the AV is always one of them.
    pub agents: usize,
    /// Number of its own earlier steps that an agent attends to.
    pub past: usize,
    /// Largest distance of an agent that is attended to, metres (except for the AV).
    pub agent_radius: f64,
    /// Radius of the known map around the AV, metres.
    pub map_radius: f64,
}

impl Config {
    /// Returns the number of places that an agent attends to.
    pub const fn places(&self) -> usize {
        self.near_pieces + self.ahead_pieces + self.stops
    }

    /// Checks the sizes.
    ///
    /// # Errors
    /// [`WeightsError`] naming the field.
    pub fn check(&self) -> Result<(), WeightsError> {
        let refuse = |field: &str, value: f64, expected: &str| {
            let text = format!("the file's configuration has {field} = {value}, expected {expected}");
            Err(WeightsError::Refused(text))
        };
        let sizes = [
            ("hidden", self.hidden),
            ("heads", self.heads),
            ("head_width", self.head_width),
            ("relation", self.relation),
            ("feed_forward", self.feed_forward),
            ("head_hidden", self.head_hidden),
            ("agent_layers", self.agent_layers),
            ("map_neighbours", self.map_neighbours),
            ("places", self.places()),
            ("agents", self.agents),
            ("past", self.past),
        ];
        for (field, value) in sizes {
            if !(1..=4096).contains(&value) {
                return refuse(field, value as f64, "1 to 4096");
            }
        }
        if self.map_layers > 64 {
            let value = self.map_layers as f64;
            return refuse("map_layers", value, "at most 64");
        }
        for (field, value) in [("agent_radius", self.agent_radius), ("map_radius", self.map_radius)] {
            if !(value > 0.0 && value < 1e4) {
                return refuse(field, value, "metres, above 0 and below 10000");
            }
        }
        Ok(())
    }
}

impl Default for Config {
    /// Size S, for two processor cores.
    fn default() -> Self {
        Self {
            hidden: 64,
            heads: 4,
            head_width: 16,
            relation: 64,
            feed_forward: 128,
            head_hidden: 128,
            map_layers: 1,
            agent_layers: 3,
            map_neighbours: 8,
            near_pieces: 14,
            ahead_pieces: 8,
            stops: 3,
            agents: 12,
            past: 4,
            agent_radius: 60.0,
            map_radius: 150.0,
        }
    }
}
