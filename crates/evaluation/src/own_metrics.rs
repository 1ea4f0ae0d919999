//! The addition of metrics that the benchmark does not have to a finished run.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use reactsim_formats::rollouts::ByName;
use reactsim_metrics::Score;
use serde::Deserialize;

use crate::error::EvaluationError;
use crate::folder::{
    RunFolder, cannot_read, for_lines, line, read_provenance, read_rows, read_summary, replace, whole_tally,
    write_json,
};
use crate::layout::{EVENTS, PROVENANCE, ROLLOUTS, ROWS};
use crate::metric_record::{MetricRecord, checked};
use crate::row::{EventHead, EventLine, EventRecord, Row};
use crate::summary::{Summary, SummaryProvenance};

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
    /// The agents of events are checked if the run kept its rollouts, which name them.
    ///
    /// # Errors
    /// [`EvaluationError`] if the file cannot be read, the run is not finished, or the file lacks a value, or
    /// has one that does not belong to the run. The folder is then left unchanged.
    pub fn add(file: &Path, folder: &Path) -> Result<(RunFolder, Summary), EvaluationError> {
        let unfit = |reason: String| EvaluationError::Refused(format!("{}: {reason}", file.display()));
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
        let kept = folder.join(ROLLOUTS);
        let kept = if kept.exists() { Some(ByName::open(&kept)?) } else { None };
        let agents = |row: &Row, rollout| -> Result<Option<BTreeSet<String>>, String> {
            let read = |kept: &ByName| kept.read(&row.scenario, &row.simulator, rollout);
            let record = kept.as_ref().map_or(Ok(None), read).map_err(|error| error.to_string())?;
            Ok(record.map(|record| record.agent_ids.into_iter().collect()))
        };
        let lines = added.fill(&mut rows, agents).map_err(unfit)?;
        let tally = whole_tally(folder, &provenance, &rows)?;
        let failures = &old.provenance.failures;
        let mut summary = Summary::new(&tally, failures, &provenance);
        // Results of an earlier program lack metrics that were added since.
        summary.restrict_to(&Row::metrics_of(&rows).into_iter().chain(old.metrics()).collect());
        summary.provenance = SummaryProvenance { run: summary.provenance.run, ..old.provenance.clone() };
        let mut others = String::new();
        for_lines(&folder.join(EVENTS), |_, text| {
            // Events of a call that was interrupted go, too.
            if serde_json::from_str::<EventHead>(text).is_ok_and(|line| !added.has(&line.metric)) {
                others.push_str(text);
            }
        })?;
        replace(&folder.join(EVENTS), |out| out.write_all((others + &lines).as_bytes()))?;
        replace(&folder.join(ROWS), |out| {
            rows.iter().try_for_each(|row| out.write_all(line(row).as_bytes()))
        })?;
        write_json(&folder.join(PROVENANCE), &provenance)?;
        run.complete(&tally, failures, &summary, false)?;
        Ok((run, summary))
    }

    fn has(&self, metric: &str) -> bool {
        self.metrics.iter().any(|own| own.id == metric)
    }

    /// Adds the values to rows; returns the events as lines of `events.jsonl`. `agents` returns the ids of the
    /// agents of a rollout, if they are known.
    fn fill(
        &self,
        rows: &mut [Row],
        agents: impl Fn(&Row, u32) -> Result<Option<BTreeSet<String>>, String>,
    ) -> Result<String, String> {
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
            if let Some(id) = of.values.keys().find(|id| !self.has(id)) {
                return Err(format!("{place}: a value of `{id}`, which is not in `metrics`"));
            }
            for own in &self.metrics {
                let value = of.values.get(&own.id);
                let value = value.ok_or_else(|| format!("{place}: metric `{}` has no entry", own.id))?;
                row.metrics.insert(own.id.clone(), value.map(Score::Value));
            }
            let agents = if of.events.is_empty() { None } else { agents(row, rollout)? };
            for event in &of.events {
                if !self.has(&event.metric)
                    || !(1..=event.last_step).contains(&event.step)
                    || event.last_step > row.steps()
                {
                    return Err(format!(
                        "{place}: an event of metric `{}` at steps {} to {}: expected an added metric, and \
                         steps from 1 to {}",
                        event.metric,
                        event.step,
                        event.last_step,
                        row.steps()
                    ));
                }
                let mut named = [Some(&event.agent), event.partner.as_ref()].into_iter().flatten();
                let is_unknown = |id: &&String| agents.as_ref().is_some_and(|agents| !agents.contains(*id));
                if let Some(id) = named.find(is_unknown) {
                    let metric = &event.metric;
                    return Err(format!(
                        "{place}: an event of metric `{metric}` has the agent `{id}`, which the scenario \
                         does not have"
                    ));
                }
                lines.push_str(&line(&EventLine::of(row, event.clone())));
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

#[cfg(test)]
mod tests {
    use serde_json::{Value as Json, json};

    use super::*;

    /// Adds a value and an event of metric `own` to one row, whose rollout has the agents `av` and `a`.
    fn filled(change: impl FnOnce(&mut Json), is_kept: bool) -> Result<String, String> {
        let event = json!({ "rollout": 0, "metric": "own", "step": 1, "last_step": 2, "agent": "a",
                            "partner": "av", "reason": null, "counted": true, "values": {} });
        let mut rollout = json!({ "scenario": "s", "simulator": "idm", "rollout": 0,
                                  "values": { "own": 1.0 }, "events": [event] });
        change(&mut rollout);
        let metric = json!({ "id": "own", "title": "Own", "unit": "", "scope": "rollout",
                             "lower_is_better": true, "source": "here" });
        let document = json!({ "metrics": [metric], "rollouts": [rollout] });
        let added: AddedMetrics = serde_json::from_value(document).unwrap();
        let row = json!({ "input": 0, "record": 0, "scenario": "s", "digest": "d", "simulator": "idm",
                          "rollout": 0, "category": null, "metrics": {} });
        let mut rows: [Row; 1] = [serde_json::from_value(row).unwrap()];
        let agents = ["av", "a"].map(str::to_owned);
        let lines = added.fill(&mut rows, |_, _| Ok(is_kept.then(|| agents.clone().into())))?;
        assert_eq!(rows[0].metrics["own"], Some(Score::Value(1.0)));
        Ok(lines)
    }

    #[test]
    fn values_of_other_metrics_and_unknown_agents_are_refused() {
        assert!(filled(|_| (), true).unwrap().contains(r#""metric":"own""#));
        let place = "scenario `s`, `idm`, rollout 0: ";
        let other = filled(|rollout| rollout["values"]["onw"] = json!(2.0), true).unwrap_err();
        assert_eq!(other, format!("{place}a value of `onw`, which is not in `metrics`"));
        for key in ["agent", "partner"] {
            let stranger = |rollout: &mut Json| rollout["events"][0][key] = json!("b");
            let unknown = filled(stranger, true).unwrap_err();
            let expected = "an event of metric `own` has the agent `b`, which the scenario does not have";
            assert_eq!(unknown, format!("{place}{expected}"));
            // Nothing names the agents of a run without its rollouts.
            filled(stranger, false).unwrap();
        }
    }
}
