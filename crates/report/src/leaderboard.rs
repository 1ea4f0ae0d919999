//! A leaderboard: the simulators of several entries in one table, by increasing collisions with the AV.

mod page;

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;

use super::csv::quote;
use super::markdown::{cell, escape, legend, method, write_aligned};
use super::table::{Column, count};
use reactsim_evaluation::reference::{Entry, Status};
use reactsim_evaluation::{BenchmarkRecord, Estimate, Summary, TableMarks};

pub use page::write_page;

/// Metric by which the lines are sorted.
const SORT_METRIC: &str = "aav-collision";

/// Formats of a leaderboard on stdout.
pub const FORMS: [&str; 3] = ["markdown", "csv", "json"];

/// A simulator of an entry.
struct Line<'a> {
    entry: &'a Entry,
    id: &'a str,
    title: &'a str,
    marks: TableMarks,
    metrics: &'a BTreeMap<String, Estimate>,
}

impl Line<'_> {
    fn mean(&self, metric: &str) -> Option<f64> {
        self.metrics.get(metric).and_then(|e| e.mean)
    }
}

/// Returns all lines, sorted by collisions with the AV, then in the order of the entries.
fn lines(entries: &[Entry]) -> Vec<Line<'_>> {
    let mut lines: Vec<Line<'_>> = entries.iter().flat_map(lines_of).collect();
    let key = |line: &Line<'_>| line.mean(SORT_METRIC).unwrap_or(f64::INFINITY);
    lines.sort_by(|a, b| key(a).total_cmp(&key(b)));
    lines
}

fn lines_of(entry: &Entry) -> Vec<Line<'_>> {
    let order = entry.summary.order();
    order.map(|(id, title, s)| Line { entry, id, title, marks: s.marks(), metrics: &s.metrics }).collect()
}

/// Returns the columns for which at least one entry has a number.
fn columns(entries: &[Entry]) -> Vec<Column> {
    let summaries: Vec<&Summary> = entries.iter().map(|e| &e.summary).collect();
    Column::used(&summaries, &[])
}

/// Describes the benchmark, scenarios and settings that all entries share.
fn about(entries: &[Entry]) -> String {
    let Some(first) = entries.first() else { return String::new() };
    let provenance = &first.summary.provenance;
    let settings = &provenance.run.settings;
    let mut parts = vec![first.benchmark.to_string(), count(provenance.scenarios, "scenario")];
    super::table::protocol(settings, &mut parts);
    parts.join(", ")
}

/// Explains the statuses of the entries.
fn status_legend(entries: &[Entry]) -> Vec<&'static str> {
    let has = |status: Status| entries.iter().any(|e| e.status == status);
    let mut all = Vec::new();
    if has(Status::Reference) {
        all.push("reference: published results whose files have the digests that they state");
    }
    if has(Status::Verified) {
        all.push("verified: the rollouts that the entry kept give its numbers again");
    }
    if has(Status::Unverified) {
        all.push("unverified: the entry kept no rollouts that could be scored again");
    }
    all
}

/// Writes a leaderboard in one of the [`FORMS`].
///
/// # Errors
/// If `out` cannot be written.
pub fn write(entries: &[Entry], form: &str, out: &mut dyn Write) -> io::Result<()> {
    match form {
        "csv" => write_csv(entries, out),
        "json" => write_json(entries, out),
        _ => write_markdown(entries, out),
    }
}

fn write_markdown(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let (columns, lines) = (columns(entries), lines(entries));
    let mut head = vec!["Entry".to_owned(), "Method".to_owned(), "Status".to_owned()];
    head.extend(columns.iter().map(Column::head));
    let mut rows = vec![head];
    for line in &lines {
        let mut row = vec![escape(&line.entry.name), method(line.title, line.marks)];
        row.push(line.entry.status.name().to_owned());
        row.extend(columns.iter().map(|c| cell(c, line.metrics.get(c.metric))));
        rows.push(row);
    }
    write_aligned(out, &rows, 3)?;
    writeln!(out)?;
    legend(out, lines.iter().map(|l| l.marks))?;
    for text in status_legend(entries) {
        writeln!(out, "{text}.")?;
    }
    writeln!(out, "{}.", escape(&about(entries)))
}

fn write_csv(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let columns = columns(entries);
    write!(out, "entry,simulator,method,oracle,status")?;
    for c in &columns {
        write!(out, ",{0},{0}-low,{0}-high", c.metric)?;
    }
    writeln!(out)?;
    let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
    for line in lines(entries) {
        let (entry, status) = (quote(&line.entry.name), line.entry.status.name());
        write!(out, "{entry},{},{},{},{status}", quote(line.id), quote(line.title), line.marks.is_oracle())?;
        for c in &columns {
            let e = line.metrics.get(c.metric).copied().unwrap_or_default();
            write!(out, ",{},{},{}", number(e.mean), number(e.low), number(e.high))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

#[derive(Serialize)]
struct JsonBoard<'a> {
    benchmark: Option<&'a BenchmarkRecord>,
    lines: Vec<JsonLine<'a>>,
}

#[derive(Serialize)]
struct JsonLine<'a> {
    entry: &'a str,
    simulator: &'a str,
    method: &'a str,
    oracle: bool,
    status: Status,
    metrics: &'a BTreeMap<String, Estimate>,
}

fn write_json(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let lines = lines(entries).into_iter().map(|line| JsonLine {
        entry: &line.entry.name,
        simulator: line.id,
        method: line.title,
        oracle: line.marks.is_oracle(),
        status: line.entry.status,
        metrics: line.metrics,
    });
    let board = JsonBoard { benchmark: entries.first().map(|e| &e.benchmark), lines: lines.collect() };
    serde_json::to_writer_pretty(&mut *out, &board)?;
    writeln!(out)
}
