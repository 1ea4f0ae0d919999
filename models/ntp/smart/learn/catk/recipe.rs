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
            smoothing: Smoothing { uniform: 0.0, spatial: 0.0 },
        }
    }
}
