//! Configuration of the network.

use reactsim_nn::{AttentionConfig, FeedForwardConfig, WeightsError};
use serde::{Deserialize, Serialize};

use super::super::tokens::TOKEN_STEPS;

/// Dimensions and options of the network, under the names of the published configurations. Unknown
/// entries are ignored; entries with a default may be omitted.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SmartConfig {
    /// Feature width.
    pub hidden_dim: usize,
    /// Number of learned frequencies per scalar.
    pub num_freq_bands: usize,
    /// Number of attention heads.
    pub num_heads: usize,
    /// Width of a head.
    pub head_dim: usize,
    /// Dropout rate of attention weights and hidden features in training.
    pub dropout: f64,
    /// Fraction of agents' steps that training hides from later steps.
    #[serde(default = "hist_drop_prob")]
    pub hist_drop_prob: f64,
    /// Number of attention layers among map tokens.
    pub num_map_layers: usize,
    /// Number of blocks of three attention layers for agents.
    pub num_agent_layers: usize,
    /// Radius within which map tokens see each other, metres.
    pub pl2pl_radius: f32,
    /// Radius within which agents see map tokens, metres.
    pub pl2a_radius: f32,
    /// Radius within which agents see each other, metres.
    pub a2a_radius: f32,
    /// Time span over which agents see their own past, frames.
    pub time_span: usize,
    /// Length of a token, frames.
    #[serde(default = "shift_frames")]
    pub shift_frames: usize,
    /// Number of tokens that agents choose from.
    pub n_token_agent: TokenCounts,
    /// Number of curves in the map vocabulary.
    #[serde(default = "n_token_map")]
    pub n_token_map: usize,
    /// Number of parameters, to be compared with that of the network; 0 if not stated.
    #[serde(default)]
    pub n_params: usize,
    /// Largest number of sources of a map token.
    #[serde(default = "max_neighbours_pl2pl")]
    pub max_neighbours_pl2pl: usize,
    /// Largest number of agents that an agent sees.
    #[serde(default = "max_neighbours_a2a")]
    pub max_neighbours_a2a: usize,
    /// Largest number of agents that see one map token.
    #[serde(default = "max_agents_per_map_token_pl2a")]
    pub max_agents_per_map_token_pl2a: usize,
    /// Number of nearest map tokens within the radius that a map token sees; 0 for all, as published.
    #[serde(default)]
    pub nearest_pl2pl: usize,
    /// Number of nearest map tokens within the radius that an agent sees; 0 for all, as published.
    #[serde(default)]
    pub nearest_pl2a: usize,
    /// Distance ahead of an agent from which the nearness of map tokens counts, metres.
    #[serde(default)]
    pub ahead_pl2a: f32,
    /// Number of nearest agents within the radius that an agent sees; 0 for all, as published.
    #[serde(default)]
    pub nearest_a2a: usize,
    /// Variance offset of layer norms; only 1e-5 is supported.
    #[serde(default = "layer_norm_eps")]
    pub layer_norm_eps: f64,
    /// Number of types of map tokens.
    #[serde(default = "map_point_types")]
    pub map_point_types: usize,
    /// Number of types of polylines.
    #[serde(default = "map_polygon_types")]
    pub map_polygon_types: usize,
    /// Number of light states.
    #[serde(default = "map_light_types")]
    pub map_light_types: usize,
    /// Number of agent classes; only 3 is supported.
    #[serde(default = "agent_types")]
    pub agent_types: usize,
    /// First width of token embeddings.
    #[serde(default = "mlp_embedding_first_width")]
    pub mlp_embedding_first_width: usize,
    /// Hidden width of the feed-forward networks, as a multiple of the feature width.
    #[serde(default = "ffn_multiple")]
    pub ffn_multiple: usize,
    /// Type of the feed-forward networks in attention layers.
    #[serde(default)]
    pub feed_forward: FeedForwardKind,
}

/// Type of the feed-forward networks in attention layers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeedForwardKind {
    /// Linear, ReLU, linear: SMART and CATK.
    #[default]
    Relu,
    /// SwiGLU with two thirds of the width: TrajTok.
    Swiglu,
}

/// Number of tokens per class, which also determines whether the classes share a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TokenCounts {
    /// The same number for all classes, and one shared head (SMART, CATK).
    Shared(usize),
    /// A separate head per class (TrajTok).
    PerClass {
        /// Number for vehicles.
        veh: usize,
        /// Number for pedestrians.
        ped: usize,
        /// Number for cyclists.
        cyc: usize,
    },
}

impl TokenCounts {
    /// Returns the numbers for vehicles, pedestrians and cyclists.
    pub fn of_classes(self) -> [usize; 3] {
        match self {
            Self::Shared(count) => [count; 3],
            Self::PerClass { veh, ped, cyc } => [veh, ped, cyc],
        }
    }
}

impl SmartConfig {
    /// Reads and checks a configuration from JSON.
    ///
    /// # Errors
    /// [`WeightsError`] naming the entry.
    pub fn from_json(text: &str) -> Result<Self, WeightsError> {
        let invalid =
            |error| WeightsError::Refused(format!("the network's configuration is not usable: {error}"));
        let config: Self = serde_json::from_str(text).map_err(invalid)?;
        config.check()?;
        Ok(config)
    }

    /// Checks the configuration.
    ///
    /// # Errors
    /// [`WeightsError`] naming the first invalid entry.
    pub fn check(&self) -> Result<(), WeightsError> {
        let wrong = |name: &str, found: String, expected: &str| {
            let text = format!("`{name}` of the network's configuration is {found}, expected {expected}");
            Err(WeightsError::Refused(text))
        };
        let counts = self.n_token_agent.of_classes();
        for (name, count) in [
            ("hidden_dim", self.hidden_dim),
            ("num_freq_bands", self.num_freq_bands),
            ("num_heads", self.num_heads),
            ("head_dim", self.head_dim),
            ("num_agent_layers", self.num_agent_layers),
            ("shift_frames", self.shift_frames),
            ("n_token_agent", counts.into_iter().min().unwrap_or(0)),
            ("n_token_map", self.n_token_map),
            ("map_point_types", self.map_point_types),
            ("map_polygon_types", self.map_polygon_types),
            ("map_light_types", self.map_light_types),
            ("mlp_embedding_first_width", self.mlp_embedding_first_width),
            ("ffn_multiple", self.ffn_multiple),
        ] {
            if !(1..=1 << 20).contains(&count) {
                return wrong(name, count.to_string(), "a whole number from 1 to 1048576");
            }
        }
        for (name, radius) in [
            ("pl2pl_radius", self.pl2pl_radius),
            ("pl2a_radius", self.pl2a_radius),
            ("a2a_radius", self.a2a_radius),
        ] {
            if !(radius > 0.0 && radius.is_finite()) {
                return wrong(name, radius.to_string(), "metres above 0");
            }
        }
        if !(0.0..=1000.0).contains(&self.ahead_pl2a) {
            return wrong("ahead_pl2a", self.ahead_pl2a.to_string(), "0 to 1000 metres");
        }
        for (name, share) in [("dropout", self.dropout), ("hist_drop_prob", self.hist_drop_prob)] {
            if !(0.0..1.0).contains(&share) {
                return wrong(name, share.to_string(), "a share from 0 to below 1");
            }
        }
        if self.layer_norm_eps != layer_norm_eps() {
            return wrong("layer_norm_eps", self.layer_norm_eps.to_string(), "1e-5");
        }
        if self.agent_types != agent_types() {
            return wrong("agent_types", self.agent_types.to_string(), "3: vehicles, pedestrians, cyclists");
        }
        Ok(())
    }

    /// Returns the number of past steps that agents see of themselves: those of the time span, but no more
    /// than there are in training. It bounds what a rollout of any length remembers.
    pub fn window(&self) -> usize {
        (self.time_span / self.shift_frames).min(TOKEN_STEPS)
    }

    /// Returns the configuration of one attention layer; bipartite layers have separate norms for
    /// sources and destinations.
    pub(super) fn attention(&self, bipartite: bool) -> AttentionConfig {
        let hidden = self.ffn_multiple * self.hidden_dim;
        AttentionConfig {
            width: self.hidden_dim,
            heads: self.num_heads,
            head_dim: self.head_dim,
            relation_width: self.hidden_dim,
            feed_forward: match self.feed_forward {
                FeedForwardKind::Relu => FeedForwardConfig::Relu(hidden),
                FeedForwardKind::Swiglu => FeedForwardConfig::swiglu(hidden),
            },
            bipartite,
            relation_norm: true,
            dropout: self.dropout,
        }
    }
}

impl Default for SmartConfig {
    /// Returns the published sizes (7 million parameters).
    fn default() -> Self {
        Self {
            hidden_dim: 128,
            num_freq_bands: 64,
            num_heads: 8,
            head_dim: 16,
            dropout: 0.1,
            hist_drop_prob: hist_drop_prob(),
            num_map_layers: 3,
            num_agent_layers: 6,
            pl2pl_radius: 10.0,
            pl2a_radius: 30.0,
            a2a_radius: 60.0,
            time_span: 30,
            shift_frames: shift_frames(),
            n_token_agent: TokenCounts::Shared(2048),
            n_token_map: n_token_map(),
            n_params: 0,
            max_neighbours_pl2pl: max_neighbours_pl2pl(),
            max_neighbours_a2a: max_neighbours_a2a(),
            max_agents_per_map_token_pl2a: max_agents_per_map_token_pl2a(),
            nearest_pl2pl: 0,
            nearest_pl2a: 0,
            ahead_pl2a: 0.0,
            nearest_a2a: 0,
            layer_norm_eps: layer_norm_eps(),
            map_point_types: map_point_types(),
            map_polygon_types: map_polygon_types(),
            map_light_types: map_light_types(),
            agent_types: agent_types(),
            mlp_embedding_first_width: mlp_embedding_first_width(),
            ffn_multiple: ffn_multiple(),
            feed_forward: FeedForwardKind::default(),
        }
    }
}

// Values of the published networks.
fn hist_drop_prob() -> f64 {
    0.1
}
fn shift_frames() -> usize {
    5
}
fn n_token_map() -> usize {
    1024
}
fn max_neighbours_pl2pl() -> usize {
    100
}
fn max_neighbours_a2a() -> usize {
    300
}
fn max_agents_per_map_token_pl2a() -> usize {
    300
}
fn layer_norm_eps() -> f64 {
    1e-5
}
fn map_point_types() -> usize {
    10
}
fn map_polygon_types() -> usize {
    4
}
fn map_light_types() -> usize {
    5
}
fn agent_types() -> usize {
    3
}
fn mlp_embedding_first_width() -> usize {
    128
}
fn ffn_multiple() -> usize {
    4
}
