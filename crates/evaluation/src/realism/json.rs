//! Scores as JSON.

use std::io::{self, Write};

use serde_json::{Map, Value, json};

use super::scores::RealismScores;

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
            let buckets = mean.buckets(config).fields();
            let intervals: Map<String, Value> = self
                .aggregates(i)
                .into_iter()
                .filter_map(|(name, estimate)| {
                    Some((name.to_owned(), json!([estimate.low?, estimate.high?])))
                })
                .collect();
            let entry = json!({
                "metrics": fields(mean.fields()),
                "buckets": fields(buckets.to_vec()),
                "intervals_95": intervals,
            });
            configs.insert(config.id.to_owned(), entry);
        }
        let all = json!({
            "method": self.method,
            "scenarios": self.rows.len(),
            "configs": configs,
            "missing": self.missing,
            "failures": self.failures.iter().map(|failure| &failure.error).collect::<Vec<_>>(),
        });
        serde_json::to_writer_pretty(&mut *out, &all)?;
        writeln!(out)
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
