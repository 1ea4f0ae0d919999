//! Recipe of a training.

use reactsim_nn::perception::Class;
use serde::{Deserialize, Serialize};

use super::super::super::smoothing::Smoothing;
use super::super::super::tokens::{MapVocabulary, TOKEN_FRAMES, Vocabulary};
use super::super::{FeedForwardKind, SmartConfig, TokenCounts};

/// Settings of training, in addition to the data and the learner's own settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// Number of agents per scenario, nearest to the AV first.
    pub agents: usize,
    /// Radius of the known map around the AV's position at the current frame, metres.
    pub map_radius: f64,
    /// Height of all boxes, metres.
    pub height: f64,
    /// Sizes of the network.
    pub network: NetworkSizes,
    /// Data augmentation.
    pub augmentation: Augmentation,
    /// Label smoothing.
    pub smoothing: Smoothing,
}

/// Sizes of the network, under the names of the published configurations. Numbers of tokens follow from the
/// vocabularies.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct NetworkSizes {
    /// Feature width.
    pub hidden_dim: usize,
    /// Number of learned frequencies per scalar.
    pub num_freq_bands: usize,
    /// Number of attention heads.
    pub num_heads: usize,
    /// Width of a head.
    pub head_dim: usize,
    /// Dropout rate of attention weights and hidden features.
    pub dropout: f64,
    /// Fraction of agents' steps that are hidden from later steps.
    pub hist_drop_prob: f64,
    /// Number of attention layers among map tokens.
    pub num_map_layers: usize,
    /// Number of blocks of three attention layers for agents.
    pub num_agent_layers: usize,
    /// Radius within which map tokens see each other, metres.
    pub pl2pl_radius: f64,
    /// Radius within which agents see map tokens, metres.
    pub pl2a_radius: f64,
    /// Radius within which agents see each other, metres.
    pub a2a_radius: f64,
    /// Number of nearest map tokens within the radius that a map token sees; 0 for all, as published.
    pub nearest_pl2pl: usize,
    /// Number of nearest map tokens within the radius that an agent sees; 0 for all, as published.
    pub nearest_pl2a: usize,
    /// Distance ahead of an agent from which the nearness of map tokens counts, metres.
    pub ahead_pl2a: f64,
    /// Number of nearest agents within the radius that an agent sees; 0 for all, as published.
    pub nearest_a2a: usize,
    /// Time span over which agents see their own past, frames.
    pub time_span: usize,
    /// First width of token embeddings.
    pub mlp_embedding_first_width: usize,
    /// Type of the feed-forward networks.
    pub feed_forward: FeedForwardKind,
    /// Whether each class has a head of its own (TrajTok), instead of one for all (SMART).
    pub separate_heads: bool,
}

/// Data augmentation.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Augmentation {
    /// Probability that a scene is mirrored.
    pub mirror: f64,
    /// Largest relative change of scale, up or down.
    pub stretch: f64,
    /// Largest number of frames by which the first step is later.
    pub shift: usize,
    /// Number of steps per sample, from a random one on.
    pub window: usize,
    /// Number of nearest tokens of which one is executed (SMART); 1 for the nearest.
    pub near_tokens: usize,
    /// Temperature in metres by which nearer ones are preferred (CATK); 0 if all are equally likely.
    pub temperature: f64,
}

impl Recipe {
    /// Returns the configuration of a network with these vocabularies.
    ///
    /// With a shared head all classes must have the same number of tokens.
    pub(super) fn config(&self, vocabulary: &Vocabulary, map_vocabulary: &MapVocabulary) -> SmartConfig {
        self.network.config(Class::ALL.map(|class| vocabulary.tokens(class)), map_vocabulary.tokens())
    }
}

impl NetworkSizes {
    fn config(&self, [veh, ped, cyc]: [usize; 3], curves: usize) -> SmartConfig {
        let n_token_agent = if self.separate_heads {
            TokenCounts::PerClass { veh, ped, cyc }
        } else {
            TokenCounts::Shared(veh)
        };
        SmartConfig {
            hidden_dim: self.hidden_dim,
            num_freq_bands: self.num_freq_bands,
            num_heads: self.num_heads,
            head_dim: self.head_dim,
            dropout: self.dropout,
            hist_drop_prob: self.hist_drop_prob,
            num_map_layers: self.num_map_layers,
            num_agent_layers: self.num_agent_layers,
            pl2pl_radius: self.pl2pl_radius as f32,
            pl2a_radius: self.pl2a_radius as f32,
            a2a_radius: self.a2a_radius as f32,
            nearest_pl2pl: self.nearest_pl2pl,
            nearest_pl2a: self.nearest_pl2a,
            ahead_pl2a: self.ahead_pl2a as f32,
            nearest_a2a: self.nearest_a2a,
            time_span: self.time_span,
            shift_frames: TOKEN_FRAMES,
            n_token_agent,
            n_token_map: curves,
            mlp_embedding_first_width: self.mlp_embedding_first_width,
            feed_forward: self.feed_forward,
            ..SmartConfig::default()
        }
    }
}

impl Default for Recipe {
    /// Returns a recipe for two processor cores: the body of SMART with 64 features.
    fn default() -> Self {
        Self {
            agents: 32,
            map_radius: 100.0,
            height: 1.8,
            network: NetworkSizes {
                hidden_dim: 64,
                num_freq_bands: 16,
                num_heads: 4,
                head_dim: 16,
                dropout: 0.0,
                hist_drop_prob: 0.1,
                num_map_layers: 1,
                num_agent_layers: 3,
                pl2pl_radius: 10.5,
                pl2a_radius: 30.0,
                a2a_radius: 60.0,
                nearest_pl2pl: 12,
                nearest_pl2a: 32,
                ahead_pl2a: 12.0,
                nearest_a2a: 12,
                time_span: 20,
                mlp_embedding_first_width: 128,
                feed_forward: FeedForwardKind::Relu,
                separate_heads: true,
            },
            augmentation: Augmentation {
                mirror: 0.5,
                stretch: 0.1,
                shift: 4,
                window: 10,
                near_tokens: 1,
                temperature: 0.0,
            },
            smoothing: Smoothing { uniform: 0.1, spatial: 0.0 },
        }
    }
}
