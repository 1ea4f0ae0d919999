//! Repeated scoring of kept rollouts.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_formats::{UndecodedScenario, rollouts::ByName};
use reactsim_metrics::{Options, metric};

use super::ReferenceError;
use crate::av::AvChoice;
use crate::folder::{read_provenance, read_rows};
use crate::layout::ROLLOUTS;
use crate::provenance::leaves::differences;
use crate::row::{RecordPosition, Row};
use crate::scoring::recorded_rollouts::{rollouts_of, score_rollouts};
use crate::source::Source;

/// Scores the kept rollouts of a finished run again, with the scenarios of `sources` in the order of its
/// inputs, and compares the scores with its rows. Returns the number of rows, or `None` if the run kept no
/// rollouts.
///
/// Outcomes of plans are not part of a rollout and are not compared.
///
/// # Errors
/// [`ReferenceError`] names the first row that the rollouts do not reproduce, or a file that cannot be read.
pub fn rescore(folder: &Path, sources: &[Source]) -> Result<Option<usize>, ReferenceError> {
    let path = folder.join(ROLLOUTS);
    if !path.exists() {
        return Ok(None);
    }
    let place = folder.display().to_string();
    let unfit = |reason: String| ReferenceError::unfit(&place, reason);
    let run = read_provenance(folder)?;
    let mut options = Options::default();
    for (name, value) in &run.metric_options {
        options.set(name, value).map_err(|error| unfit(format!("provenance.json: {error}")))?;
    }
    let rollouts = ByName::open(&path)?;
    let mut pairs: BTreeMap<RecordPosition, BTreeMap<String, Vec<Row>>> = BTreeMap::new();
    let rows = read_rows(folder)?;
    // Rows of an earlier program lack metrics that were added since; those of a user cannot be computed.
    let mut metrics = Row::metrics_of(&rows);
    metrics.retain(|id| metric(id).is_some());
    for row in rows {
        pairs.entry(row.place()).or_default().entry(row.simulator.clone()).or_default().push(row);
    }
    let (judges_av, enters) = (run.settings.planner().is_some(), run.settings.entering.is_some());
    // Rows have a category only if the AV is the deviated one.
    let deviated = run.settings.av.parse::<AvChoice>().is_ok_and(|av| av.follows_deviations());
    let mut scored = 0;
    for (input, source) in sources.iter().enumerate() {
        for (record, pending) in (source.open)(0)?.enumerate() {
            let place = RecordPosition { input, record };
            let scenario = pending.and_then(UndecodedScenario::decode)?;
            for (simulator, stated) in pairs.remove(&place).unwrap_or_default() {
                let mut records = Vec::new();
                for index in stated.iter().filter_map(|row| row.rollout) {
                    let record = rollouts.read(&scenario.id, &simulator, index)?;
                    let missing = || {
                        unfit(format!("rollout {index} of `{}` with `{simulator}` is missing", scenario.id))
                    };
                    records.push(record.ok_or_else(missing)?);
                }
                let recorded = rollouts_of(&scenario, &records, enters);
                let recorded =
                    recorded.map_err(|error| unfit(format!("scenario `{}`: {error}", scenario.id)))?;
                let digest = scenario.digest();
                let (again, _) =
                    score_rollouts(place, &scenario, digest, &simulator, &recorded, options, judges_av);
                let comparable = |row: &Row| {
                    let mut row = row.clone();
                    row.restrict_to(&metrics);
                    Row {
                        category: row.category.filter(|_| deviated),
                        difficulty: row.difficulty.filter(|_| deviated),
                        outcomes: BTreeMap::new(),
                        // The digest covers the scenario; earlier versions stored no notes.
                        notes: BTreeMap::new(),
                        ..row
                    }
                };
                for (stated, again) in stated.iter().zip(&again) {
                    let (stated, again) = (comparable(stated), comparable(again));
                    if let Some((field, a, b)) = differences(&stated, &again).into_iter().next() {
                        return Err(unfit(format!(
                            "the rollouts do not reproduce the rows: scenario `{}`, `{simulator}`: \
                             `{field}` is {a} in the rows and {b} from the rollouts",
                            scenario.id
                        )));
                    }
                }
                scored += stated.len();
            }
        }
    }
    match pairs.into_values().flat_map(BTreeMap::into_values).flatten().next() {
        Some(row) => Err(unfit(format!("scenario `{}` is not in the benchmark", row.scenario))),
        None => Ok(Some(scored)),
    }
}
