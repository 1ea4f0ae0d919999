//! Scores as text, from which they are restored to the bit.

use reactsim_metrics::wosac::{Feature, RolloutShare, WosacMetrics};
use serde::{Deserialize, Serialize};

use super::scores::{RealismFailure, RealismRow, RealismScores};

/// Scores of a part.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct ScoresText {
    rows: Vec<RowRecord>,
    failures: Vec<RealismFailure>,
    missing: Vec<String>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct RowRecord {
    scenario_id: String,
    rollouts: usize,
    metrics: Vec<MetricsRecord>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    shares: Vec<Vec<RolloutShare>>,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct MetricsRecord {
    metametric: f64,
    displacements: [f64; 2],
    likelihoods: [Option<f64>; Feature::COUNT],
    rates: [f64; 2],
    traffic_light_violation_rate: Option<f64>,
}

impl MetricsRecord {
    fn of(metrics: &WosacMetrics) -> Self {
        Self {
            metametric: metrics.metametric,
            displacements: [metrics.average_displacement_error, metrics.min_average_displacement_error],
            likelihoods: metrics.likelihoods,
            rates: [metrics.simulated_collision_rate, metrics.simulated_offroad_rate],
            traffic_light_violation_rate: metrics.simulated_traffic_light_violation_rate,
        }
    }

    fn metrics(self) -> WosacMetrics {
        let ([mean, min], [collisions, offroad]) = (self.displacements, self.rates);
        WosacMetrics {
            metametric: self.metametric,
            average_displacement_error: mean,
            min_average_displacement_error: min,
            likelihoods: self.likelihoods,
            simulated_collision_rate: collisions,
            simulated_offroad_rate: offroad,
            simulated_traffic_light_violation_rate: self.traffic_light_violation_rate,
        }
    }
}

impl RealismScores {
    /// Returns the scores as text, from which [`Self::add_text`] restores them to the bit.
    ///
    /// # Panics
    /// Never: scores are text and numbers.
    pub fn to_text(&self) -> String {
        let row = |row: &RealismRow| RowRecord {
            scenario_id: row.scenario_id.clone(),
            rollouts: row.rollouts,
            metrics: row.metrics.iter().map(MetricsRecord::of).collect(),
            shares: row.shares.clone(),
        };
        let part = ScoresText {
            rows: self.rows.iter().map(row).collect(),
            failures: self.failures.clone(),
            missing: self.missing.clone(),
        };
        serde_json::to_string(&part).expect("scores are text and numbers")
    }

    /// Adds scores that [`Self::to_text`] returned.
    ///
    /// # Errors
    /// The reason why the text has no scores of these configurations.
    pub fn add_text(&mut self, text: &[u8]) -> Result<(), String> {
        let scores: ScoresText = serde_json::from_slice(text).map_err(|error| error.to_string())?;
        for RowRecord { scenario_id, rollouts, metrics, shares } in scores.rows {
            if metrics.len() != self.configs.len() {
                return Err(format!("`{scenario_id}` has {} metrics", metrics.len()));
            }
            if !shares.is_empty() && shares.len() != metrics.len() {
                return Err(format!("`{scenario_id}` has shares in {} metrics", shares.len()));
            }
            let metrics = metrics.into_iter().map(MetricsRecord::metrics).collect();
            self.rows.push(RealismRow { scenario_id, rollouts, metrics, shares });
        }
        self.failures.extend(scores.failures);
        self.missing.extend(scores.missing);
        Ok(())
    }
}
