//! Metrics that the benchmark does not have: their records in files, and their addition to a finished run.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use parking_lot::Mutex;
use reactsim_metrics::{MetricSpec, Scope, Unit, check_own};
use reactsim_scene::FUTURE;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serialize};

use crate::error::EvaluationError;
use crate::folder::completion::complete;
use crate::folder::{
    RunFolder, cannot_read, for_lines, line, read_provenance, read_rows, read_summary, replace, tally_of,
};
use crate::layout::{EVENTS, PROVENANCE, ROWS};
use crate::row::{EventHead, EventLine, EventRecord, Row, Value};
use crate::summary::{Summary, SummaryProvenance};

/// A metric that the benchmark does not have, as stored in files.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MetricRecord {
    /// Id.
    pub id: String,
    /// Title in tables.
    pub title: String,
    /// Unit: `count`, `rate`, `m`, `m/s²`, another one, or empty.
    pub unit: String,
    /// Input of one value: `rollout`, `scenario` or `av` ([`Scope`]).
    pub scope: String,
    /// Whether lower values are better.
    pub lower_is_better: bool,
    /// Source of the definition.
    pub source: String,
}

/// Descriptions of the metrics of all files that were read. They live as long as the program, as those of the
/// benchmark do, and there is one per record.
static SPECS: Mutex<Vec<&'static MetricSpec>> = Mutex::new(Vec::new());

impl MetricRecord {
    /// Creates the record of a metric.
    pub fn of(spec: &MetricSpec) -> Self {
        Self {
            id: spec.id.to_owned(),
            title: spec.title.to_owned(),
            unit: spec.unit.name().to_owned(),
            scope: spec.scope.name().to_owned(),
            lower_is_better: spec.lower_is_better,
            source: spec.source.to_owned(),
        }
    }

    /// Returns the description of the metric. An unknown scope is that of a rollout.
    pub fn spec(&self) -> &'static MetricSpec {
        let mut specs = SPECS.lock();
        if let Some(known) = specs.iter().find(|spec| Self::of(spec) == *self) {
            return known;
        }
        let text = |text: &String| -> &'static str { text.clone().leak() };
        let spec: &'static MetricSpec = Box::leak(Box::new(MetricSpec {
            id: text(&self.id),
            title: text(&self.title),
            unit: Unit::from_name(text(&self.unit)),
            scope: self.scope().unwrap_or(Scope::Rollout),
            lower_is_better: self.lower_is_better,
            source: text(&self.source),
        }));
        specs.push(spec);
        spec
    }

    fn scope(&self) -> Option<Scope> {
        Scope::ALL.into_iter().find(|scope| scope.name() == self.scope)
    }
}

/// Reads records of metrics and checks them: tables and pages print their texts as they are.
pub(super) fn checked<'de, D: Deserializer<'de>>(file: D) -> Result<Vec<MetricRecord>, D::Error> {
    let records = Vec::<MetricRecord>::deserialize(file)?;
    if let Some(wrong) = records.iter().find(|record| record.scope().is_none()) {
        let known = Scope::ALL.map(Scope::name).join(", ");
        let (id, scope) = (&wrong.id, &wrong.scope);
        return Err(D::Error::custom(format!("metric `{id}`: scope is `{scope}`, expected one of {known}")));
    }
    let specs: Vec<_> = records.iter().map(MetricRecord::spec).collect();
    check_own(&specs).map_err(D::Error::custom)?;
    Ok(records)
}

/// Metrics that another program computed for every rollout of a finished run.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AddedMetrics {
    #[serde(deserialize_with = "checked")]
    metrics: Vec<MetricRecord>,
    rollouts: Vec<AddedRollout>,
}

/// Values and events of one rollout.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct AddedRollout {
    scenario: String,
    simulator: String,
    rollout: u32,
    /// Value by id of the metric; `None` if nothing could be evaluated.
    values: BTreeMap<String, Option<f64>>,
    events: Vec<EventRecord>,
}

impl AddedMetrics {
    /// Adds the metrics of a JSON file to a finished run: to rows, events, summary and provenance. A metric
    /// that was added earlier is replaced by one with the same id. Returns the folder with the new summary.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read, the run is not finished, or the file lacks a value, or
    /// has one that does not belong to the run. The folder is then left unchanged.
    pub fn add(file: &Path, folder: &Path) -> Result<(RunFolder, Summary), EvaluationError> {
        let unfit = |reason| EvaluationError::AddedMetrics { path: file.to_owned(), reason };
        let text = fs::read_to_string(file).map_err(cannot_read(file))?;
        let added: Self = serde_json::from_str(&text).map_err(|error| unfit(error.to_string()))?;
        let old = read_summary(folder)?;
        if !folder.join(ROWS).exists() {
            return Err(unfit(format!("{} has no {ROWS}: only runs get metrics", folder.display())));
        }
        let run = RunFolder::of_finished(folder)?;
        let mut provenance = read_provenance(folder)?;
        provenance.own_metrics.retain(|own| !added.has(&own.id));
        provenance.own_metrics.extend(added.metrics.iter().cloned());
        let mut rows = read_rows(folder)?;
        let lines = added.fill(&mut rows).map_err(unfit)?;
        let (tally, dropped) = tally_of(&provenance, &rows);
        if let Some((scenario, simulator)) = dropped {
            return Err(EvaluationError::IncompleteRows { path: folder.to_owned(), scenario, simulator });
        }
        let failures = &old.provenance.failures;
        let mut summary = Summary::new(&tally, failures, &provenance);
        // Results of an earlier program lack metrics that were added since.
        summary.restrict_to(&Row::metrics_of(&rows).into_iter().chain(old.metrics()).collect());
        summary.provenance = SummaryProvenance { run: summary.provenance.run, ..old.provenance.clone() };
        let mut kept = String::new();
        for_lines(&folder.join(EVENTS), |_, text| {
            // Events of a call that was interrupted go, too.
            if serde_json::from_str::<EventHead>(text).is_ok_and(|event| !added.has(&event.metric)) {
                kept.push_str(text);
            }
        })?;
        replace(&folder.join(EVENTS), |out| out.write_all((kept + &lines).as_bytes()))?;
        replace(&folder.join(ROWS), |out| {
            rows.iter().try_for_each(|row| out.write_all(line(row).as_bytes()))
        })?;
        run.put(PROVENANCE, &provenance.to_json())?;
        complete(&run, &tally, failures, &summary, false)?;
        Ok((run, summary))
    }

    fn has(&self, metric: &str) -> bool {
        self.metrics.iter().any(|own| own.id == metric)
    }

    /// Adds the values to rows; returns the events as lines of `events.jsonl`.
    fn fill(&self, rows: &mut [Row]) -> Result<String, String> {
        let key = |of: &AddedRollout| (of.scenario.clone(), of.simulator.clone(), of.rollout);
        let mut found: BTreeMap<_, &AddedRollout> = self.rollouts.iter().map(|of| (key(of), of)).collect();
        if found.len() < self.rollouts.len() {
            return Err("a rollout is given twice".to_owned());
        }
        let mut lines = String::new();
        for row in rows {
            let Some(rollout) = row.rollout else { continue };
            let place = format!("scenario `{}`, `{}`, rollout {rollout}", row.scenario, row.simulator);
            let of = found.remove(&(row.scenario.clone(), row.simulator.clone(), rollout));
            let of = of.ok_or_else(|| format!("{place}: no values are given"))?;
            for own in &self.metrics {
                let value = of.values.get(&own.id);
                let value = value.ok_or_else(|| format!("{place}: metric `{}` has no entry", own.id))?;
                row.metrics.insert(own.id.clone(), value.map(Value::Value));
            }
            for event in &of.events {
                if !self.has(&event.metric)
                    || !(1..=event.last_step).contains(&event.step)
                    || event.last_step > FUTURE
                {
                    return Err(format!(
                        "{place}: an event of metric `{}` at steps {} to {}: expected an added metric, and \
                         steps from 1 to {FUTURE}",
                        event.metric, event.step, event.last_step
                    ));
                }
                lines.push_str(&line(&EventLine::of_record(row, event)));
            }
        }
        match found.keys().next() {
            Some((scenario, simulator, rollout)) => {
                Err(format!("scenario `{scenario}`, `{simulator}`, rollout {rollout} is not in the run"))
            }
            None => Ok(lines),
        }
    }
}
