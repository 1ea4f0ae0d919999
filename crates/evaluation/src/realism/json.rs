//! Scores as JSON.

use std::io::{self, Write};

use reactsim_metrics::wosac::{Config, Feature, RolloutShare};
use serde::Serialize;
use serde_json::value::{RawValue, to_raw_value};
use serde_json::{Map, Value, json};

use super::scores::{RealismRow, RealismScores};

/// The scores of a set of rollouts as JSON.
#[derive(Serialize)]
struct ScoresDocument<'a> {
    configs: Map<String, Value>,
    failures: Vec<&'a String>,
    method: &'a str,
    missing: &'a [String],
    scenarios: usize,
    /// Shares of the rollouts of a scenario in a configuration, one line each.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    shares: Vec<Box<RawValue>>,
}

impl RealismScores {
    /// Writes the scores as JSON, with the field names of the official messages.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn write_json(&self, out: &mut dyn Write) -> io::Result<()> {
        let mut configs = Map::new();
        for (i, (config, mean)) in self.means().into_iter().enumerate() {
            let fields = |fields: Vec<(&'static str, Option<f64>)>| -> Map<String, Value> {
                fields
                    .into_iter()
                    .filter_map(|(name, value)| Some((name.to_owned(), json!(value?))))
                    .collect()
            };
            let intervals: Map<String, Value> = self
                .aggregates(i)
                .into_iter()
                .filter_map(|(name, estimate)| {
                    Some((name.to_owned(), json!([estimate.low?, estimate.high?])))
                })
                .collect();
            let entry = json!({
                "metrics": fields(mean.fields()),
                "buckets": fields(mean.buckets(config).to_vec()),
                "intervals_95": intervals,
            });
            configs.insert(config.id.to_owned(), entry);
        }
        let document = ScoresDocument {
            configs,
            failures: self.failures.iter().map(|failure| &failure.error).collect(),
            method: &self.method,
            missing: &self.missing,
            scenarios: self.rows.len(),
            shares: self.shares()?,
        };
        serde_json::to_writer_pretty(&mut *out, &document)?;
        writeln!(out)
    }

    /// Returns the shares of the rollouts, if rows have them, by scenario and configuration.
    fn shares(&self) -> serde_json::Result<Vec<Box<RawValue>>> {
        let mut lines = Vec::new();
        for row in &self.rows {
            for (config, shares) in self.configs.iter().zip(&row.shares) {
                lines.push(to_raw_value(&shares_of(row, config, shares))?);
            }
        }
        Ok(lines)
    }

    /// Writes the scores of every scenario as JSON lines, one per scenario and configuration.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn write_rows(&self, out: &mut dyn Write) -> io::Result<()> {
        for row in &self.rows {
            for (config, metrics) in self.configs.iter().zip(&row.metrics) {
                let mut line = Map::new();
                line.insert("scenario_id".to_owned(), row.scenario_id.as_str().into());
                line.insert("method".to_owned(), self.method.as_str().into());
                line.insert("config".to_owned(), config.id.into());
                line.insert("rollouts".to_owned(), row.rollouts.into());
                line.extend(
                    metrics.fields().into_iter().filter_map(|(name, v)| Some((name.to_owned(), v?.into()))),
                );
                writeln!(out, "{}", Value::Object(line))?;
            }
        }
        Ok(())
    }
}

/// Returns the shares of a row in a configuration: arrays by metric, of one number per rollout, which is null
/// if there is one rollout.
fn shares_of(row: &RealismRow, config: &Config, shares: &[RolloutShare]) -> Map<String, Value> {
    let mut line = Map::new();
    line.insert("scenario_id".to_owned(), row.scenario_id.as_str().into());
    line.insert("config".to_owned(), config.id.into());
    let numbers = |share: &dyn Fn(&RolloutShare) -> Option<f64>| -> Value {
        (0..row.rollouts).map(|rollout| shares.get(rollout).and_then(share)).collect()
    };
    line.insert("metametric".to_owned(), numbers(&|share| Some(share.metametric)));
    for feature in Feature::ALL.into_iter().filter(|feature| config.has(*feature)) {
        let likelihood = numbers(&|share| share.likelihoods[feature as usize]);
        line.insert(feature.likelihood_name().to_owned(), likelihood);
    }
    line
}

#[cfg(test)]
mod tests {
    use reactsim_metrics::wosac::WosacMetrics;

    use super::*;

    fn document(scores: &RealismScores) -> Value {
        let mut text = Vec::new();
        scores.write_json(&mut text).unwrap();
        serde_json::from_slice(&text).unwrap()
    }

    #[test]
    fn shares_are_arrays_over_rollouts_and_survive_as_text() {
        let configs = vec![Config::CHALLENGE_2025, Config::CHALLENGE_2024];
        let share = |value: f64, lights| {
            let mut likelihoods = [Some(0.1 * value); Feature::COUNT];
            likelihoods[Feature::TrafficLightViolation as usize] = lights;
            RolloutShare { metametric: value / 3.0, likelihoods }
        };
        let row = |id: &str, shares: Vec<Vec<RolloutShare>>| RealismRow {
            scenario_id: id.to_owned(),
            rollouts: shares.first().map_or(2, |shares| shares.len().max(1)),
            metrics: vec![WosacMetrics::default(); 2],
            shares,
        };
        let two = vec![vec![share(1.0, Some(0.0)), share(-2.0, Some(0.7))], vec![share(0.0, None); 2]];
        let rows = vec![row("two", two), row("single", vec![Vec::new(); 2])];
        let scores = RealismScores { configs: configs.clone(), rows, ..RealismScores::default() };
        let document_of_all = document(&scores);
        let shares = document_of_all["shares"].as_array().unwrap();
        assert_eq!(shares.len(), 4);
        assert_eq!((&shares[0]["scenario_id"], &shares[0]["config"]), (&json!("two"), &json!("2025")));
        assert_eq!(shares[0]["metametric"], json!([1.0 / 3.0, -2.0 / 3.0]));
        assert_eq!(shares[0]["traffic_light_violation_likelihood"], json!([0.0, 0.7]));
        assert_eq!(shares[1]["linear_speed_likelihood"], json!([0.0, 0.0]));
        assert_eq!(shares[1].get("traffic_light_violation_likelihood"), None);
        assert_eq!(shares[2]["metametric"], json!([null]));
        assert_eq!(shares[2]["collision_indication_likelihood"], json!([null]));

        let mut restored = RealismScores { configs: configs.clone(), ..RealismScores::default() };
        restored.add_text(scores.to_text().as_bytes()).unwrap();
        assert_eq!(restored.rows, scores.rows);
        let rows = vec![row("plain", Vec::new())];
        let plain = RealismScores { configs, rows, ..RealismScores::default() };
        assert_eq!(document(&plain).get("shares"), None);
        assert!(!plain.to_text().contains("shares"));
    }
}
