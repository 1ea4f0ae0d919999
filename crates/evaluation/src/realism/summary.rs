//! The aggregates of a leaderboard for each simulator of a study, as a file.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::RealismScores;
use crate::error::EvaluationError;
use crate::folder::{read_json, write_json};
use crate::statistics::Estimate;

/// Name of the file with the realism metrics of the simulators of a study.
pub const REALISM_SUMMARY: &str = "wosac.json";
/// Name of the file with the realism metrics of every scenario, as JSON lines.
pub const REALISM_ROWS: &str = "wosac.jsonl";

/// The realism metrics of a simulator: means over scenarios with intervals.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RealismSummary {
    /// Id of the simulator.
    pub id: String,
    /// Title of the simulator.
    pub title: String,
    /// Id of the configuration of the metrics.
    pub config: String,
    /// Number of scenarios with scores.
    pub scenarios: usize,
    /// Number of scenarios without scores.
    pub failures: usize,
    /// Aggregates by the names of the official message; metrics that the configuration lacks are absent.
    pub aggregates: BTreeMap<String, Estimate>,
}

impl RealismSummary {
    /// Summarises the scores of a simulator in their first configuration; `None` without scores.
    pub fn of(id: &str, scores: &RealismScores) -> Option<Self> {
        let config = scores.configs.first().filter(|_| !scores.rows.is_empty())?;
        let aggregates = scores.aggregates(0).into_iter().filter(|(_, estimate)| estimate.mean.is_some());
        Some(Self {
            id: id.to_owned(),
            title: scores.method.clone(),
            config: config.id.to_owned(),
            scenarios: scores.rows.len(),
            failures: scores.failures.len(),
            aggregates: aggregates.map(|(name, estimate)| (name.to_owned(), estimate)).collect(),
        })
    }

    /// Writes summaries into the folder of a study.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be written.
    pub fn write_all(summaries: &[Self], study: &Path) -> Result<(), EvaluationError> {
        write_json(&study.join(REALISM_SUMMARY), &summaries)
    }

    /// Reads the summaries in the folder of a study; none if it has none.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read or is damaged.
    pub fn read_all(study: &Path) -> Result<Vec<Self>, EvaluationError> {
        Ok(read_json(&study.join(REALISM_SUMMARY))?.unwrap_or_default())
    }
}
