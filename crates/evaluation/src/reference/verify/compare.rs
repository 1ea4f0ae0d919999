//! Comparison of the results of a run with those of a reference.

use std::collections::BTreeMap;

use reactsim_metrics::Score;

use super::{Difference, LargestDifference, SimulatorCheck, Subject, Verification, is_exact};
use crate::folder::tally_of;
use crate::provenance::leaves::{differences, leaves};
use crate::reference::{Reference, SimulatorClass};
use crate::row::{RecordPosition, Row};
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// The key of a row within a simulator's rows.
type Key = (RecordPosition, Option<u32>);

/// Prefixes of the fields of a row that may differ between machines. All other fields describe the scenario.
const ROLLOUT_FIELDS: [&str; 3] = ["metrics.", "outcomes.", "direction_tracking"];

/// Compares rows, in the metrics that the reference has. Rows of networks count only for every `every`th
/// scenario.
pub(super) fn rows(
    reference: &Reference,
    expected: &[Row],
    mut found: Vec<Row>,
    every: usize,
    same_machine: bool,
) -> Verification {
    let metrics = Row::metrics_of(expected);
    found.iter_mut().for_each(|row| row.restrict_to(&metrics));
    // References of earlier versions store no notes.
    if expected.iter().all(|row| row.notes.is_empty()) {
        found.iter_mut().for_each(|row| row.notes.clear());
    }
    let mut verification = Verification::of(Subject::Rows);
    for simulator in &reference.provenance.simulators {
        let step = if simulator.is_network() { every } else { 1 };
        let all = expected.iter().filter(|r| r.simulator == simulator.id);
        let (expected, left_out): (Vec<&Row>, Vec<&Row>) = all.partition(|r| r.record.is_multiple_of(step));
        let found: Vec<&Row> = found.iter().filter(|r| r.simulator == simulator.id).collect();
        let class = &reference.record.simulators[&simulator.id];
        let exact = is_exact(class, same_machine);
        let mut check = SimulatorCheck::of(&simulator.id, class, exact);
        (check.compared, check.left_out) = (expected.len(), left_out.len());
        let mut differences = differing_rows(&expected, &found, &mut check);
        if !exact {
            // All rows must exist and the scenarios must be equal; results of rollouts may differ within
            // bounds.
            differences.retain(|d| !ROLLOUT_FIELDS.iter().any(|field| d.field.starts_with(field)));
            differences.extend(beyond_bounds(reference, class, (&expected, &left_out), &found, &mut check));
        }
        check.passed = differences.is_empty();
        verification.differences.extend(differences);
        verification.left_out += check.left_out;
        verification.simulators.push(check);
    }
    verification
}

/// Returns the fields in which rows differ. Counts the differing rows, and finds the largest difference of a
/// metric.
fn differing_rows(expected: &[&Row], found: &[&Row], check: &mut SimulatorCheck) -> Vec<Difference> {
    let key = |row: &&Row| -> Key { (row.place(), row.rollout) };
    let mut rest: BTreeMap<Key, &Row> = found.iter().map(|row| (key(row), *row)).collect();
    let mut differing = Vec::new();
    let difference = |row: &Row, field: String, reference: String, found: String| Difference {
        simulator: row.simulator.clone(),
        scenario: Some(row.scenario.clone()),
        rollout: row.rollout,
        field,
        reference,
        found,
    };
    for row in expected {
        let Some(other) = rest.remove(&key(row)) else {
            check.differing += 1;
            differing.push(difference(row, "row".to_owned(), "present".to_owned(), "absent".to_owned()));
            continue;
        };
        if *row == other {
            continue;
        }
        check.differing += 1;
        note_largest(row, other, check);
        differing.extend(fields(row, other).into_iter().map(|(field, a, b)| difference(row, field, a, b)));
    }
    for row in rest.into_values() {
        check.differing += 1;
        differing.push(difference(row, "row".to_owned(), "absent".to_owned(), "present".to_owned()));
    }
    differing
}

/// Returns the fields in which two rows differ, with whole metrics as fields.
fn fields(a: &Row, b: &Row) -> Vec<(String, String, String)> {
    let text = |row: &Row| {
        let without = Row { metrics: BTreeMap::new(), ..row.clone() };
        let mut fields = leaves(&without);
        for (metric, value) in &row.metrics {
            let text = value.map_or_else(|| "none".to_owned(), score_text);
            fields.insert(format!("metrics.{metric}"), text);
        }
        fields
    };
    differences(&text(a), &text(b))
        .into_iter()
        .map(|(field, a, b)| (field, a.trim_matches('"').to_owned(), b.trim_matches('"').to_owned()))
        .collect()
}

/// Returns a score with its components, to the last bit.
fn score_text(score: Score) -> String {
    match score {
        Score::Rate { hits, valid } => format!("{hits} of {valid}"),
        Score::Count(n) => n.to_string(),
        Score::Mean { sum, n } => format!("{sum} / {n}"),
        Score::Value(v) => v.to_string(),
    }
}

fn note_largest(a: &Row, b: &Row, check: &mut SimulatorCheck) {
    let value = |row: &Row, metric: &str| row.metrics.get(metric).copied().flatten()?.value();
    for metric in a.metrics.keys() {
        let Some((a, b)) = value(a, metric).zip(value(b, metric)) else { continue };
        let difference = (b - a).abs();
        if difference > 0.0 && check.largest.as_ref().is_none_or(|l| difference > l.difference) {
            check.largest = Some(LargestDifference { metric: metric.clone(), difference, bound: None });
        }
    }
}

/// Returns the metrics whose mean paired difference is beyond its bound. If only a share of the scenarios is
/// compared, bounds are divided by the square root of the share, in proportion to the spread of a mean.
fn beyond_bounds(
    reference: &Reference,
    class: &SimulatorClass,
    (expected, left_out): (&[&Row], &[&Row]),
    found: &[&Row],
    check: &mut SimulatorCheck,
) -> Vec<Difference> {
    let SimulatorClass::Tolerance { bounds } = class else { return Vec::new() };
    let widening = (1.0 + left_out.len() as f64 / expected.len().max(1) as f64).sqrt();
    let owned = |rows: &[&Row]| -> Vec<Row> { rows.iter().map(|row| (*row).clone()).collect() };
    let (stated, _) = tally_of(&reference.provenance, &owned(expected));
    let (again, _) = tally_of(&reference.provenance, &owned(found));
    check.largest = None;
    let mut beyond = Vec::new();
    for (metric, bound) in bounds {
        let pairs = pairs(&stated, &again, &check.id, metric);
        let n = pairs.len() as f64;
        let beyond_bound = |reference: String, found: String| {
            Difference::over_all(&check.id, format!("metrics.{metric}"), reference, found)
        };
        if pairs.is_empty() {
            // A metric with values in the reference must have values again.
            if !self::pairs(&stated, &stated, &check.id, metric).is_empty() {
                beyond.push(beyond_bound("present".to_owned(), "none".to_owned()));
            }
            continue;
        }
        let bound = bound * widening;
        let mean = |of: fn(&(f64, f64)) -> f64| pairs.iter().map(of).sum::<f64>() / n;
        let difference = mean(|(a, b)| b - a).abs();
        let part = |l: &LargestDifference| l.difference / l.bound.unwrap_or(1.0).max(f64::MIN_POSITIVE);
        let one = LargestDifference { metric: metric.clone(), difference, bound: Some(bound) };
        if difference > bound {
            let found = format!("{} (bound {bound})", mean(|(_, b)| *b));
            beyond.push(beyond_bound(mean(|(a, _)| *a).to_string(), found));
        }
        if difference > 0.0 && check.largest.as_ref().is_none_or(|l| part(&one) > part(l)) {
            check.largest = Some(one);
        }
    }
    beyond
}

/// Returns the values of a metric in the scenarios in which both tallies have one.
fn pairs(first: &Tally, second: &Tally, simulator: &str, metric: &str) -> Vec<(f64, f64)> {
    let at = |tally: &Tally| {
        let simulator = tally.simulators.iter().position(|s| s == simulator)?;
        Some((simulator, tally.metric(metric)?))
    };
    let Some(((s, m), _)) = at(first).zip(at(second)) else { return Vec::new() };
    let value =
        |tally: &Tally, place: &RecordPosition| tally.entries.get(place)?.cells[s].as_ref()?.values[m];
    first.entries.keys().filter_map(|place| value(first, place).zip(value(second, place))).collect()
}

/// Compares the values of summaries, in the metrics that the reference has, for references without rows.
/// Simulators in `left_out` are not compared.
pub(super) fn summaries(
    reference: &Reference,
    found: Option<&Summary>,
    left_out: Option<&[&str]>,
    same_machine: bool,
) -> Verification {
    let mut verification = Verification::of(Subject::Summary);
    let stated = &reference.summary;
    let found = found.cloned().map(|mut found| {
        found.restrict_to(&stated.metrics());
        found
    });
    let found = found.as_ref();
    for simulator in &reference.provenance.simulators {
        let id = &simulator.id;
        let class = &reference.record.simulators[id];
        let exact = is_exact(class, same_machine);
        let expected = &stated.simulators[id];
        let mut check = SimulatorCheck::of(id, class, exact);
        let values = leaves(expected).len();
        if left_out.is_some_and(|ids| ids.contains(&id.as_str())) {
            check.left_out = values;
            verification.left_out += values;
            verification.simulators.push(check);
            continue;
        }
        check.compared = values;
        let mut differing = Vec::new();
        let same_scenarios =
            found.is_some_and(|f| f.provenance.scenarios_blake3 == stated.provenance.scenarios_blake3);
        match found.and_then(|f| f.simulators.get(id)).filter(|_| same_scenarios) {
            None => {
                let blake3 = found.map_or("absent", |f| f.provenance.scenarios_blake3.as_str());
                differing.push((
                    "scenarios_blake3".to_owned(),
                    stated.provenance.scenarios_blake3.clone(),
                    blake3.to_owned(),
                ));
            }
            Some(again) => {
                let all = differences(expected, again);
                check.differing = all.len();
                for (metric, estimate) in &expected.metrics {
                    let other = again.metrics.get(metric).and_then(|e| e.mean);
                    let Some((a, b)) = estimate.mean.zip(other) else { continue };
                    let bound = match class {
                        SimulatorClass::Tolerance { bounds } if !exact => bounds.get(metric).copied(),
                        _ => None,
                    };
                    let difference = (b - a).abs();
                    if difference > 0.0 && check.largest.as_ref().is_none_or(|l| difference > l.difference) {
                        check.largest = Some(LargestDifference { metric: metric.clone(), difference, bound });
                    }
                    if !exact && bound.is_some_and(|bound| difference > bound) {
                        let bound = bound.unwrap_or_default();
                        differing.push((
                            format!("metrics.{metric}"),
                            a.to_string(),
                            format!("{b} (bound {bound})"),
                        ));
                    }
                }
                if exact {
                    differing = all;
                } else if expected.scenarios != again.scenarios {
                    let (a, b) = (expected.scenarios.to_string(), again.scenarios.to_string());
                    differing.push(("scenarios".to_owned(), a, b));
                }
            }
        }
        check.passed = differing.is_empty();
        let over_all = |(field, reference, found)| Difference::over_all(id, field, reference, found);
        verification.differences.extend(differing.into_iter().map(over_all));
        verification.simulators.push(check);
    }
    verification
}
