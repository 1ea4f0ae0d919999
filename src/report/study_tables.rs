//! Studies as Markdown tables and as JSON.

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;

use super::Run;
use super::comparison::signed;
use super::markdown::{cell, escape, legend, method, write_aligned};
use super::table::{Column, MAIN_COLUMNS, count, program, provenance};
use crate::evaluation::{
    Comparison, Difference, Estimate, Member, SimulatorSummary, StudyKind, StudyResults, Summary,
};

/// Metrics of the interaction with the AV, as in the paper's studies.
const REACTION_METRICS: &[&str] = &["aav-collision", "aav-ttc"];
/// Metrics of the realism protocol: those of the paper's table 2, and the smallest displacement over
/// rollouts.
const REALISM_METRICS: &[&str] = &["aav-collision", "aav-ttc", "ade", "min-ade", "kinematic-likelihood"];

/// Returns the columns of a member of a study.
fn columns(kind: StudyKind, member: &Member, also: &[Column]) -> Vec<Column> {
    let of = |ids: &[&'static str]| ids.iter().map(|metric| Column { metric }).collect();
    let usual = match kind {
        StudyKind::Replan | StudyKind::Realism if member.protocol.as_deref() == Some("realism") => {
            of(REALISM_METRICS)
        }
        StudyKind::Replan | StudyKind::Realism => of(REACTION_METRICS),
        StudyKind::Guards => MAIN_COLUMNS.to_vec(),
    };
    Column::with(usual, also)
}

/// Returns the members of a study with their results.
fn members(results: &StudyResults) -> impl Iterator<Item = (&Member, &Summary)> {
    results.study.members.iter().zip(&results.summaries)
}

/// Writes the tables of a study as Markdown, with `also` as additional columns.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_markdown(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    write_tables(results, also, out)?;
    writeln!(out)?;
    for (member, summary) in members(results) {
        let run = Run { name: &member.folder, summary };
        writeln!(out, "- `{}`: {}", member.folder, escape(&provenance(&run)))?;
    }
    Ok(())
}

/// Writes the tables of a study for a document, with benchmark, number of scenarios and program below them.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_document(results: &StudyResults, out: &mut dyn Write) -> io::Result<()> {
    write_tables(results, &[], out)?;
    let Some(summary) = results.summaries.first() else { return Ok(()) };
    let run = &summary.provenance.run;
    let benchmark = run.benchmark.as_ref().map(|b| format!("{b}, ")).unwrap_or_default();
    let scenarios = count(summary.provenance.scenarios, "scenario");
    writeln!(out, "\n{}.", escape(&format!("{benchmark}{scenarios}, {}", program(run))))
}

/// Writes the tables and their legend.
fn write_tables(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    match results.study.kind {
        StudyKind::Replan => replan(results, also, out)?,
        StudyKind::Realism => realism(results, also, out)?,
        StudyKind::Guards => guards(results, also, out)?,
    }
    let all = || results.summaries.iter().flat_map(|s| s.simulators.values());
    writeln!(out)?;
    legend(out, all().map(SimulatorSummary::access))?;
    if results.study.kind == StudyKind::Guards {
        writeln!(
            out,
            "Differences are paired, scenario by scenario; bold where the interval, which need not be \
             symmetric, leaves 0 out."
        )?;
    }
    Ok(())
}

/// Formats an estimate of a simulator in a run; a dash if there is none.
fn number(summary: &Summary, simulator: &str, column: &Column) -> String {
    cell(column, summary.simulators.get(simulator).and_then(|s| s.metrics.get(column.metric)))
}

/// Writes one table per metric: simulators by replan interval.
fn replan(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    let Some(first) = results.summaries.first() else { return Ok(()) };
    let Some((member, _)) = members(results).next() else { return Ok(()) };
    for (i, column) in columns(results.study.kind, member, also).into_iter().enumerate() {
        let head = column.head();
        writeln!(out, "{}{head} by steps (of 0.1 s) between two plans:\n", if i > 0 { "\n" } else { "" })?;
        let steps = members(results).map(|(m, _)| m.replan_steps.unwrap_or_default().to_string());
        let mut rows: Vec<Vec<String>> = vec![std::iter::once("Method".to_owned()).chain(steps).collect()];
        for (id, title, simulator) in first.order() {
            let numbers = results.summaries.iter().map(|summary| number(summary, id, &column));
            rows.push(std::iter::once(method(title, simulator.access())).chain(numbers).collect());
        }
        write_aligned(out, &rows, 1)?;
    }
    Ok(())
}

/// Writes one table: simulators by metrics of both protocols.
fn realism(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    let Some(first) = results.summaries.first() else { return Ok(()) };
    let kind = results.study.kind;
    let mut head = vec!["Method".to_owned()];
    for (member, _) in members(results) {
        let protocol = super::markdown::capital(member.protocol.as_deref().unwrap_or_default());
        head.extend(columns(kind, member, also).iter().map(|c| format!("{protocol}: {}", c.head())));
    }
    let mut rows = vec![head];
    for (id, title, simulator) in first.order() {
        let mut row = vec![method(title, simulator.access())];
        for (member, summary) in members(results) {
            row.extend(columns(kind, member, also).iter().map(|c| number(summary, id, c)));
        }
        rows.push(row);
    }
    write_aligned(out, &rows, 1)
}

/// Writes two tables: the metrics of all variants, and their differences from the unchanged simulators.
fn guards(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    let Some(first) = results.summaries.first() else { return Ok(()) };
    let columns = Column::with(MAIN_COLUMNS.to_vec(), also);
    let titles = ["Method", "Variant"].map(str::to_owned).into_iter();
    let head: Vec<String> = titles.chain(columns.iter().map(Column::head)).collect();
    let (mut values, mut differences) = (vec![head.clone()], vec![head]);
    for (original, title, simulator) in first.order() {
        let method = method(title, simulator.access());
        for (i, (member, summary)) in members(results).enumerate() {
            for (id, _) in member.originals.iter().filter(|(_, of)| *of == original) {
                let about = [method.clone(), member.label.clone()].into_iter();
                values.push(about.clone().chain(columns.iter().map(|c| number(summary, id, c))).collect());
                if let Some(found) = difference(results, i, id) {
                    let cells = columns.iter().map(|c| difference_cell(c, found.comparison.as_ref()));
                    differences.push(about.chain(cells).collect());
                }
            }
        }
    }
    write_aligned(out, &values, 2)?;
    if differences.len() > 1 {
        writeln!(out, "\nDifference to the same simulator as it is:\n")?;
        write_aligned(out, &differences, 2)?;
    }
    Ok(())
}

fn difference<'a>(results: &'a StudyResults, member: usize, simulator: &str) -> Option<&'a Difference> {
    results.differences.iter().find(|d| d.member == member && d.simulator == simulator)
}

/// Formats a difference with half the width of its interval, if it has one; bold if the interval excludes 0.
fn difference_cell(column: &Column, comparison: Option<&Comparison>) -> String {
    let found = comparison.and_then(|c| c.metrics.get(column.metric)).map(|paired| &paired.difference);
    match found {
        Some(Estimate { mean: Some(mean), low: Some(low), high: Some(high), .. }) => {
            let text = format!("{} ±{}", signed(column, *mean), column.number((high - low) / 2.0));
            if *low > 0.0 || *high < 0.0 { format!("**{text}**") } else { text }
        }
        Some(Estimate { mean: Some(mean), .. }) => signed(column, *mean),
        _ => "–".to_owned(),
    }
}

/// The numbers of a study's tables.
#[derive(Serialize)]
struct Numbers<'a> {
    study: StudyKind,
    members: Vec<MemberNumbers<'a>>,
}

#[derive(Serialize)]
struct MemberNumbers<'a> {
    #[serde(flatten)]
    member: &'a Member,
    /// Number of scenarios with a result.
    scenarios: usize,
    /// Number of failures.
    failures: usize,
    simulators: Vec<SimulatorNumbers<'a>>,
}

#[derive(Serialize)]
struct SimulatorNumbers<'a> {
    id: &'a str,
    title: &'a str,
    oracle: bool,
    scenarios: usize,
    failed: usize,
    /// Estimates by metric.
    metrics: BTreeMap<&'static str, Estimate>,
    /// By metric: this simulator minus the unchanged one, with the p-value of the difference.
    #[serde(skip_serializing_if = "Option::is_none")]
    difference: Option<BTreeMap<&'static str, PairedEstimate>>,
}

#[derive(Serialize)]
struct PairedEstimate {
    #[serde(flatten)]
    estimate: Estimate,
    p: f64,
}

/// Writes the numbers of the tables as JSON, by member and simulator, with `also` as additional columns.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_json(results: &StudyResults, also: &[Column], out: &mut dyn Write) -> io::Result<()> {
    let kind = results.study.kind;
    let members = members(results).enumerate().map(|(i, (member, summary))| {
        let columns = columns(kind, member, also);
        let simulators = summary.order().map(|(id, title, simulator)| {
            let found = difference(results, i, id).and_then(|d| d.comparison.as_ref());
            SimulatorNumbers {
                id,
                title,
                oracle: simulator.oracle,
                scenarios: simulator.scenarios,
                failed: simulator.failed,
                metrics: metrics(&columns, simulator),
                difference: found.map(|comparison| differences(&columns, comparison)),
            }
        });
        MemberNumbers {
            member,
            scenarios: summary.provenance.scenarios,
            failures: summary.provenance.failures.len(),
            simulators: simulators.collect(),
        }
    });
    serde_json::to_writer_pretty(&mut *out, &Numbers { study: kind, members: members.collect() })?;
    out.write_all(b"\n")
}

fn metrics(columns: &[Column], simulator: &SimulatorSummary) -> BTreeMap<&'static str, Estimate> {
    columns.iter().filter_map(|c| Some((c.metric, *simulator.metrics.get(c.metric)?))).collect()
}

fn differences(columns: &[Column], comparison: &Comparison) -> BTreeMap<&'static str, PairedEstimate> {
    let paired = columns.iter().filter_map(|c| Some((c.metric, comparison.metrics.get(c.metric)?)));
    paired
        .map(|(metric, found)| (metric, PairedEstimate { estimate: found.difference, p: found.p }))
        .collect()
}
