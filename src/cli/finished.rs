//! Output of a finished run in addition to its table.

use std::path::Path;

use anyhow::Context;

use super::output::{count, note, say};
use crate::evaluation::{
    EVENTS, Failure, ROUTE_ENDS, ROWS, RunFolder, SUMMARY, SimulatorSummary, Summary, TABLE,
};
use crate::models::qp::FAILED_SOLVES;
use crate::report::{Run, TableStyle, exporter, markdown_text};
use crate::rollout::{NOT_FINITE, PLANNED_ALONE};

/// Writes the table of a run to its folder, followed by plan outcomes and failures.
pub(super) fn put_table(folder: &RunFolder, summary: &Summary, style: TableStyle<'_>) -> anyhow::Result<()> {
    let Some(markdown) = exporter("markdown") else { return Ok(()) };
    let mut text = Vec::new();
    let run = [Run { name: "", summary }];
    markdown.export(&run, style, &mut text).context("could not make the table")?;
    let mut text = String::from_utf8_lossy(&text).into_owned();
    text.push_str(&outcomes(summary));
    text.push_str(&notes(summary));
    text.push_str(&failures(summary));
    Ok(folder.put(TABLE, &text)?)
}

/// Prints the contents of a run folder, and what to do with it.
pub(super) fn show_next_steps(folder: &Path, keeps_rollouts: bool) {
    let folder = folder.display();
    let scenes = if keeps_rollouts { "" } else { " (scenes need --keep-rollouts)" };
    note(format_args!(
        "\n{folder} contains {TABLE}, {SUMMARY}, {ROWS} and {EVENTS}\n\
         next: reactsim view {folder}{scenes}\n      \
         reactsim compare {folder} OTHER"
    ));
}

/// Prints which selected scenarios there are not, how many scenarios have no deviation in the file, and how
/// many deviations have no scenario.
pub(super) fn report_left_out(summary: &Summary) {
    let p = &summary.provenance;
    for id in &p.missing_ids {
        say(format_args!("warning: no scenario has the id `{id}`"));
    }
    if p.passed_over > 0 {
        let n = count(p.passed_over, "scenario");
        say(format_args!("{n} passed over: no deviated AV in the file of deviations"));
    }
    if p.unused_deviations > 0 {
        let n = count(p.unused_deviations, "deviation");
        say(format_args!("warning: {n} not used: for scenarios that are not among those that were read"));
    }
}

/// Outcomes of plans that are faults of a simulator, and what they mean.
const PROBLEMS: [(&str, &str); 3] = [
    (NOT_FINITE, "plans were not finite; their agents continued as before"),
    (PLANNED_ALONE, "rollouts were repeated one at a time because their batch failed twice"),
    (FAILED_SOLVES, "quadratic programs could not be solved; the vehicles used a fallback"),
];

/// Warns of plans that did not end as they should.
pub(super) fn report_problems(summary: &Summary) {
    for (id, simulator) in &summary.simulators {
        for (outcome, meaning) in PROBLEMS {
            if let Some(n) = simulator.outcomes.get(outcome) {
                say(format_args!("warning: {id}: {n} {meaning}"));
            }
        }
        let mut ends = simulator.outcomes.keys().filter(|outcome| outcome.starts_with(ROUTE_ENDS));
        if let Some(first) = ends.next() {
            let n = count(1 + ends.count(), "place");
            say(format_args!(
                "warning: {id}: the AV brakes or stands where its route ends, at {n} (first {first})"
            ));
        }
    }
}

/// Prints the notes of the scenarios.
pub(super) fn report_notes(summary: &Summary) {
    for (id, found) in &summary.provenance.notes {
        say(format_args!("note: {}", found.text(id)));
    }
}

/// Returns a Markdown list below a title; nothing without lines.
fn list(title: &str, lines: impl Iterator<Item = String>) -> String {
    let lines: String = lines.map(|line| format!("- {line}\n")).collect();
    if lines.is_empty() { lines } else { format!("\n{title}:\n\n{lines}") }
}

/// Returns the notes about the scenarios.
fn notes(summary: &Summary) -> String {
    list("Notes", summary.provenance.notes.iter().map(|(id, found)| found.text(id)))
}

/// Returns the plan outcomes, with a line per simulator that counts some.
pub(super) fn outcomes(summary: &Summary) -> String {
    let counting = summary.simulators.iter().filter(|(_, s)| !s.outcomes.is_empty());
    let line = |(id, simulator): (&String, &SimulatorSummary)| {
        let all = simulator.outcomes.iter().map(|(name, n)| format!("{n} {name}"));
        format!("{id}: {}", all.collect::<Vec<_>>().join(", "))
    };
    list("How plans ended", counting.map(line))
}

/// Returns the failures.
fn failures(summary: &Summary) -> String {
    let line = |failure: &Failure| {
        let simulator = failure.simulator.as_deref().map(|s| format!(" ({s})")).unwrap_or_default();
        let line = format!("{} record {}{simulator}: {}", failure.file, failure.record, failure.error);
        markdown_text(&line)
    };
    list("Failed", summary.provenance.failures.iter().map(line))
}
