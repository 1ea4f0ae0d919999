//! The measures of a network.

use serde::{Deserialize, Serialize};

use reactsim::models::nn::{AttentionConfig, FeedForwardConfig};

/// The measures of a network, under the names of the published configurations. Entries that it does not know are passed over; those with
/// a default may be left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SmartConfig {
    /// Width of all features.
    pub hidden_dim: usize,
    /// Learned frequencies per scalar.
    pub num_freq_bands: usize,
    /// Attention heads.
    pub num_heads: usize,
    /// Width of a head.
    pub head_dim: usize,
    /// Share of attention weights and hidden features that training drops.
    pub dropout: f64,
    /// Share of agents' steps that training hides from the later ones.
    #[serde(default = "hist_drop_prob")]
    pub hist_drop_prob: f64,
    /// Attention layers among map tokens.
    pub num_map_layers: usize,
    /// Blocks of three attention layers for agents.
    pub num_agent_layers: usize,
    /// Map tokens see those nearer than this, m.
    pub pl2pl_radius: f32,
    /// Agents see map tokens nearer than this, m.
    pub pl2a_radius: f32,
    /// Agents see agents nearer than this, m.
    pub a2a_radius: f32,
    /// How far back agents see themselves, frames.
    pub time_span: usize,
    /// Frames of a token.
    #[serde(default = "shift_frames")]
    pub shift_frames: usize,
    /// How many tokens agents choose among.
    pub n_token_agent: TokenCounts,
    /// How many curves map tokens are taken from.
    #[serde(default = "n_token_map")]
    pub n_token_map: usize,
    /// The number of parameters, to be compared with that of the network; 0 says nothing.
    #[serde(default)]
    pub n_params: usize,
    /// At most so many sources of a map token.
    #[serde(default = "max_neighbours_pl2pl")]
    pub max_neighbours_pl2pl: usize,
    /// At most so many agents near an agent.
    #[serde(default = "max_neighbours_a2a")]
    pub max_neighbours_a2a: usize,
    /// At most so many agents that see one map token.
    #[serde(default = "max_agents_per_map_token_pl2a")]
    pub max_agents_per_map_token_pl2a: usize,
    /// Added to variances in layer norms; no other value than 1e-5 is known.
    #[serde(default = "layer_norm_eps")]
    pub layer_norm_eps: f64,
    /// Kinds of map tokens.
    #[serde(default = "map_point_types")]
    pub map_point_types: usize,
    /// Kinds of polylines.
    #[serde(default = "map_polygon_types")]
    pub map_polygon_types: usize,
    /// States of lights.
    #[serde(default = "map_light_types")]
    pub map_light_types: usize,
    /// Classes of agents; no other number than 3 is known.
    #[serde(default = "agent_types")]
    pub agent_types: usize,
    /// First width of token embeddings.
    #[serde(default = "mlp_embedding_first_width")]
    pub mlp_embedding_first_width: usize,
    /// Width of the feed-forward networks, in widths of the features.
    #[serde(default = "ffn_multiple")]
    pub ffn_multiple: usize,
    /// Which feed-forward networks the attention layers have.
    #[serde(default)]
    pub feed_forward: FeedForwardKind,
}

/// Which feed-forward networks the attention layers have.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeedForwardKind {
    /// Linear, ReLU, linear: SMART and CATK.
    #[default]
    Relu,
    /// SwiGLU of two thirds of the width: TrajTok.
    Swiglu,
}

/// How many tokens there are to choose among, and with it whether the classes share a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum TokenCounts {
    /// As many for every class, and one head (SMART, CATK).
    Shared(usize),
    /// Heads of their own (TrajTok).
    PerClass {
        /// Vehicles.
        veh: usize,
        /// Pedestrians.
        ped: usize,
        /// Cyclists.
        cyc: usize,
    },
}

impl TokenCounts {
    /// Of vehicles, pedestrians and cyclists.
    pub fn of_classes(self) -> [usize; 3] {
        match self {
            Self::Shared(count) => [count; 3],
            Self::PerClass { veh, ped, cyc } => [veh, ped, cyc],
        }
    }
}

/// A configuration that no network can have.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// Not JSON, or entries are missing or of another type.
    #[error("the network's configuration is not usable: {0}")]
    Json(#[from] serde_json::Error),
    /// An entry has a value that makes no sense.
    #[error("`{name}` of the network's configuration is {found}, expected {expected}")]
    Value {
        /// Which entry.
        name: &'static str,
        /// What it is.
        found: String,
        /// What it should be.
        expected: &'static str,
    },
}

impl SmartConfig {
    /// From JSON, checked.
    ///
    /// # Errors
    /// [`ConfigError`] that names the entry.
    pub fn from_json(text: &str) -> Result<Self, ConfigError> {
        let config: Self = serde_json::from_str(text)?;
        config.check()?;
        Ok(config)
    }

    /// Whether a network can have these measures.
    ///
    /// # Errors
    /// [`ConfigError::Value`] that names the first entry that does not fit.
    pub fn check(&self) -> Result<(), ConfigError> {
        let wrong = |name, found: String, expected| Err(ConfigError::Value { name, found, expected });
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

    /// How many steps back agents see themselves.
    pub fn window(&self) -> usize {
        self.time_span / self.shift_frames
    }

    /// One attention layer; bipartite ones have norms for either side.
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

// The values of the published networks.
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
