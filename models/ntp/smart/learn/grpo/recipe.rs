//! Recipe of a fine-tuning.

use serde::{Deserialize, Serialize};

use super::super::super::super::Sampling;
use super::super::closed_loop::Excerpt;

/// Settings of fine-tuning, in addition to the data and the learner's own settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GrpoRecipe {
    /// Excerpt of each scene that becomes a sample.
    #[serde(flatten)]
    pub excerpt: Excerpt,
    /// Number of rollouts of a scenario that are compared with each other.
    pub rollouts: usize,
    /// Weight of the divergence from the network that the training begins with.
    pub anchor: f64,
    /// Settings for drawing tokens.
    pub sampling: Sampling,
    /// Rewards and fines.
    pub rewards: Rewards,
}

/// Fines of agents, and how far they look ahead.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rewards {
    /// Fine for the first contact with the AV that an agent brings about.
    pub av_contact: f64,
    /// Fine for the first contact with another agent that an agent brings about.
    pub contact: f64,
    /// Fine per step and metre of distance from the record.
    pub distance: f64,
    /// Distance from the record, metres, above which the fine grows no more.
    pub most_distance: f64,
    /// Factor by which a fine counts less for every step that it is later.
    pub discount: f64,
}

impl Default for GrpoRecipe {
    fn default() -> Self {
        Self {
            excerpt: Excerpt {
                agents: 16,
                map_radius: 100.0,
                height: 1.8,
                steps: 16,
                external_av: true,
                mirror: 0.5,
                stretch: 0.1,
            },
            rollouts: 4,
            anchor: 0.03,
            sampling: Sampling { top_k: 5, temperature: 1.0 },
            rewards: Rewards {
                av_contact: 2.0,
                contact: 1.0,
                distance: 0.006,
                most_distance: 10.0,
                discount: 0.9,
            },
        }
    }
}
