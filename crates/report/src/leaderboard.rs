//! A leaderboard: the simulators of several entries in one table, by their Pareto rank.

mod page;

use std::collections::BTreeMap;
use std::io::{self, Write};

use serde::Serialize;

use super::csv::quote;
use super::markdown::{NUMBERS, cell, escape, marks, method, write_aligned};
use super::table::{Column, count};
use reactsim_evaluation::reference::{Entry, Status};
use reactsim_evaluation::{BenchmarkRecord, Estimate, Summary, TableMarks};

pub use page::write_page;

/// Metrics of the ranks: safety, realism and progress.
const OBJECTIVES: [&str; 3] = ["aav-collision", "ade", "progress"];

/// Formats of a leaderboard on stdout.
pub const FORMS: [&str; 3] = ["markdown", "csv", "json"];

/// A simulator of an entry.
struct Line<'a> {
    entry: &'a Entry,
    id: &'a str,
    title: &'a str,
    marks: TableMarks,
    metrics: &'a BTreeMap<String, Estimate>,
    /// The Pareto rank, from 1; `None` for oracles, and without a value of every objective.
    rank: Option<usize>,
}

impl Line<'_> {
    /// Returns the values of the objectives, less is better.
    fn costs(&self) -> Option<[f64; OBJECTIVES.len()]> {
        if self.marks.is_oracle() {
            return None;
        }
        let cost = |metric: &'static str| {
            let sign = if Column::benchmark(metric).kind().1 { 1.0 } else { -1.0 };
            Some(sign * self.mean(metric)?)
        };
        let [safety, realism, progress] = OBJECTIVES.map(cost);
        Some([safety?, realism?, progress?])
    }

    fn mean(&self, metric: &str) -> Option<f64> {
        self.metrics.get(metric).and_then(|e| e.mean)
    }
}

/// The lines of a leaderboard.
struct Lines<'a> {
    /// By rank, then by collisions with the AV, then in the order of the entries; those without a rank last.
    shown: Vec<Line<'a>>,
    /// Number of lines that are left out, because another entry has the same simulator with the same numbers
    /// and at least the same status; of those with the same status, the first is shown.
    repeated: usize,
}

impl<'a> Lines<'a> {
    fn of(entries: &'a [Entry]) -> Self {
        let mut shown: Vec<Line<'_>> = Vec::new();
        let mut repeated = 0;
        for line in entries.iter().flat_map(lines_of) {
            match shown.iter_mut().find(|other| other.id == line.id && other.metrics == line.metrics) {
                Some(other) => {
                    repeated += 1;
                    if line.entry.status < other.entry.status {
                        *other = line;
                    }
                }
                None => shown.push(line),
            }
        }
        let costs: Vec<_> = shown.iter().map(Line::costs).collect();
        for (line, rank) in shown.iter_mut().zip(ranks(&costs)) {
            line.rank = rank;
        }
        let collisions = |line: &Line<'_>| line.mean(OBJECTIVES[0]).unwrap_or(f64::INFINITY);
        let rank = |line: &Line<'_>| line.rank.unwrap_or(usize::MAX);
        shown.sort_by(|a, b| rank(a).cmp(&rank(b)).then(collisions(a).total_cmp(&collisions(b))));
        Self { shown, repeated }
    }

    /// Explains marks, numbers and ranks, which lines are left out, and the statuses.
    fn legend(&self) -> Vec<String> {
        let titles = OBJECTIVES.map(|metric| Column::benchmark(metric).title()).join(", ");
        let mut all = marks(self.shown.iter().map(|line| line.marks));
        all.push(NUMBERS.to_owned());
        all.push(format!(
            "Rank 1: no other method is at least as good in {titles} and better in one; rank 2: the same without \
             those of rank 1, and so on. Oracles, and methods without one of these numbers, have no \
             rank"
        ));
        if self.repeated > 0 {
            all.push(format!("{} of another entry left out", count(self.repeated, "repetition")));
        }
        all.extend(status_legend(&self.shown).map(str::to_owned));
        all
    }
}

/// Returns the Pareto rank of each line with costs.
fn ranks<const N: usize>(costs: &[Option<[f64; N]>]) -> Vec<Option<usize>> {
    let is_better = |a: &[f64; N], b: &[f64; N]| {
        let mut pairs = a.iter().zip(b);
        pairs.clone().all(|(a, b)| a <= b) && pairs.any(|(a, b)| a < b)
    };
    let mut ranks = vec![None; costs.len()];
    for rank in 1..=costs.len() {
        let left = |i: &usize| ranks[*i].is_none() && costs[*i].is_some();
        let open: Vec<usize> = (0..costs.len()).filter(left).collect();
        let is_beaten = |i: usize| {
            let beats = |other: usize| Some(is_better(costs[other].as_ref()?, costs[i].as_ref()?));
            open.iter().any(|&other| beats(other) == Some(true))
        };
        let front: Vec<usize> = open.iter().copied().filter(|&i| !is_beaten(i)).collect();
        front.into_iter().for_each(|i| ranks[i] = Some(rank));
    }
    ranks
}

fn lines_of(entry: &Entry) -> Vec<Line<'_>> {
    let order = entry.summary.order();
    order
        .map(|(id, title, s)| Line { entry, id, title, marks: s.marks(), metrics: &s.metrics, rank: None })
        .collect()
}

/// Returns a rank as the text of a cell.
fn rank_text(rank: Option<usize>) -> String {
    rank.map_or_else(|| "–".to_owned(), |rank| rank.to_string())
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

/// Explains the statuses of the lines.
fn status_legend(lines: &[Line<'_>]) -> impl Iterator<Item = &'static str> {
    let texts = [
        (Status::Reference, "reference: published results whose files have the digests that they state"),
        (Status::Verified, "verified: the rollouts that the entry kept give its numbers again"),
        (Status::Unverified, "unverified: the entry kept no rollouts that could be scored again"),
    ];
    let is_there = |status: Status| lines.iter().any(|line| line.entry.status == status);
    texts.into_iter().filter(move |(status, _)| is_there(*status)).map(|(_, text)| text)
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
    let (columns, lines) = (columns(entries), Lines::of(entries));
    let mut head = ["Rank", "Entry", "Method", "Status"].map(str::to_owned).to_vec();
    head.extend(columns.iter().map(Column::head));
    let row = |line: &Line<'_>| {
        let name = escape(&line.entry.name);
        let mut row = vec![rank_text(line.rank), name, method(line.title, line.marks)];
        row.push(line.entry.status.name().to_owned());
        row.extend(columns.iter().map(|c| cell(c, line.metrics.get(c.metric))));
        row
    };
    write_aligned(out, &head, lines.shown.iter().map(row), 4)?;
    writeln!(out)?;
    for text in lines.legend() {
        writeln!(out, "{text}.")?;
    }
    writeln!(out, "{}.", escape(&about(entries)))
}

fn write_csv(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let columns = columns(entries);
    write!(out, "rank,entry,simulator,method,oracle,status")?;
    for c in &columns {
        write!(out, ",{0},{0}-low,{0}-high", c.metric)?;
    }
    writeln!(out)?;
    let number = |v: Option<f64>| v.map(|v| v.to_string()).unwrap_or_default();
    for line in Lines::of(entries).shown {
        let (entry, status) = (quote(&line.entry.name), line.entry.status.name());
        let rank = line.rank.map(|rank| rank.to_string()).unwrap_or_default();
        let (id, title) = (quote(line.id), quote(line.title));
        write!(out, "{rank},{entry},{id},{title},{},{status}", line.marks.is_oracle())?;
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
    /// Number of lines that are left out, because they repeat one of these.
    repeated: usize,
    lines: Vec<JsonLine<'a>>,
}

#[derive(Serialize)]
struct JsonLine<'a> {
    rank: Option<usize>,
    entry: &'a str,
    simulator: &'a str,
    method: &'a str,
    oracle: bool,
    status: Status,
    metrics: &'a BTreeMap<String, Estimate>,
}

fn write_json(entries: &[Entry], out: &mut dyn Write) -> io::Result<()> {
    let Lines { shown, repeated } = Lines::of(entries);
    let lines = shown.into_iter().map(|line| JsonLine {
        rank: line.rank,
        entry: &line.entry.name,
        simulator: line.id,
        method: line.title,
        oracle: line.marks.is_oracle(),
        status: line.entry.status,
        metrics: line.metrics,
    });
    let benchmark = entries.first().map(|e| &e.benchmark);
    let board = JsonBoard { benchmark, repeated, lines: lines.collect() };
    serde_json::to_writer_pretty(&mut *out, &board)?;
    writeln!(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_method_that_another_beats_has_a_later_rank() {
        let costs = [
            Some([0.1, 2.0, -0.9]),
            Some([0.2, 1.0, -0.9]),
            // Worse than the first, equal to the second.
            Some([0.2, 2.0, -0.9]),
            None,
            Some([0.2, 1.0, -0.9]),
            // Worse than the third, too.
            Some([0.3, 2.0, -0.9]),
        ];
        assert_eq!(ranks(&costs), [Some(1), Some(1), Some(2), None, Some(1), Some(3)]);
    }

    #[test]
    fn repeated_lines_have_the_best_status_in_any_order() {
        let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/../../references/replan-reactive/steps-10");
        let summary = reactsim_evaluation::read_summary(std::path::Path::new(folder)).unwrap();
        let name = String::new();
        let benchmark = BenchmarkRecord { name: name.clone(), version: name.clone(), blake3: name };
        let entry = |status: Status| Entry {
            name: status.name().to_owned(),
            benchmark: benchmark.clone(),
            summary: summary.clone(),
            status,
        };
        let methods = summary.order().count();
        assert!(methods > 0);
        let (best, middle, last) = (Status::Reference, Status::Verified, Status::Unverified);
        for (order, shown) in [
            (vec![last, middle], middle),
            (vec![middle, last], middle),
            (vec![last, best, middle], best),
            (vec![best, middle, last], best),
        ] {
            let entries: Vec<Entry> = order.iter().copied().map(entry).collect();
            let lines = Lines::of(&entries);
            assert!(lines.shown.iter().all(|line| line.entry.status == shown), "{order:?}");
            let repeated = (order.len() - 1) * methods;
            assert_eq!((lines.shown.len(), lines.repeated), (methods, repeated), "{order:?}");
            let legend: Vec<&str> = status_legend(&lines.shown).collect();
            assert!(legend.len() == 1 && legend[0].starts_with(shown.name()), "{legend:?}");
            let mut json = Vec::new();
            write(&entries, "json", &mut json).unwrap();
            let json: serde_json::Value = serde_json::from_slice(&json).unwrap();
            assert_eq!(json["repeated"], repeated);
            assert_eq!(json["lines"][0]["status"], shown.name());
        }
    }
}
