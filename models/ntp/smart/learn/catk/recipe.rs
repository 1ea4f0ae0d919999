//! Recipe of a fine-tuning.

use serde::{Deserialize, Serialize};

use super::super::super::super::smoothing::Smoothing;
use super::super::closed_loop::Excerpt;

/// Settings of fine-tuning, in addition to the data and the learner's own settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CatkRecipe {
    /// Excerpt of each scene that becomes a sample.
    #[serde(flatten)]
    pub excerpt: Excerpt,
    /// Number of likeliest tokens of which the nearest to the record is executed.
    pub top_k: usize,
    /// Mean corner distance, metres, by which a token loses preference to the nearest one by the factor e; 0:
    /// the nearest one is executed.
    pub temperature: f64,
    /// Distance to the AV, metres, within which labels have another weight.
    pub near_av: f64,
    /// Factor on the weight of these labels.
    pub near_av_weight: f64,
    /// Label smoothing.
    pub smoothing: Smoothing,
}

impl Default for CatkRecipe {
    /// Returns the published settings, with the numbers of agents and map pieces of `smart`.
    fn default() -> Self {
        Self {
            excerpt: Excerpt {
                agents: 32,
                map_radius: 100.0,
                height: 1.8,
                steps: 16,
                external_av: false,
                mirror: 0.5,
                stretch: 0.0,
            },
            top_k: 32,
            temperature: 0.0,
            near_av: 0.0,
            near_av_weight: 1.0,
            smoothing: Smoothing { uniform: 0.0, spatial: 0.0 },
        }
    }
}
