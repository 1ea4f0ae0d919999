//! Recipe of a fine-tuning by realism.

use reactsim_metrics::wosac::{Bucket, Config, Feature};
use serde::{Deserialize, Serialize};

/// Configuration of the metrics that are rewarded.
pub(super) const CONFIG: Config = Config::CHALLENGE_2025;

/// Settings of fine-tuning, in addition to the data and the learner's own settings.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealismRecipe {
    /// Number of rollouts of a scenario that are judged together.
    pub rollouts: usize,
    /// Number of agents per scenario that learn, nearest to the AV first.
    pub agents: usize,
    /// Features of the metametric that are rewarded.
    pub features: Features,
    /// Weights of the rewards, and of the divergence from the first network.
    pub weights: Weights,
}

/// A part of the features of the metametric.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Features {
    /// All features.
    All,
    /// Speeds and accelerations.
    Kinematic,
}

/// Weights in the objective.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Weights {
    /// Weight of the metametric.
    pub realism: f64,
    /// Weight of the fines for contacts and over-reaction with an AV that leaves its log.
    pub reactions: f64,
    /// Weight of the divergence from the first network (Kullback and Leibler, nats per token).
    pub kl: f64,
}

impl Default for RealismRecipe {
    fn default() -> Self {
        Self {
            rollouts: 8,
            agents: 32,
            features: Features::All,
            weights: Weights { realism: 1.0, reactions: 1.0, kl: 0.03 },
        }
    }
}

impl Features {
    /// Returns the part of the metametric, or of a share in it, that these features make up. `likelihoods`
    /// are in the order of [`Feature::ALL`].
    pub(super) fn part(self, mut likelihoods: [Option<f64>; Feature::COUNT]) -> f64 {
        if self == Self::Kinematic {
            for (feature, likelihood) in Feature::ALL.into_iter().zip(&mut likelihoods) {
                *likelihood = likelihood.filter(|_| feature.bucket() == Bucket::Kinematic);
            }
        }
        CONFIG.metametric(&likelihoods)
    }
}
