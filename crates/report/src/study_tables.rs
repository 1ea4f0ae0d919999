//! Tables of studies: simulators by replan interval, by protocol, by variant, by planner, or by values of
//! axes.

mod errors;
mod json;
mod latex;
mod markdown;
mod planners;

use super::TableStyle;
use super::table::{Column, MAIN_COLUMNS, best_number};
use reactsim_evaluation::{
    Difference, Estimate, Member, SimulatorSummary, StudyKind, StudyResults, Summary, TableMarks,
};

pub use json::write_json;
pub use latex::write_latex;
pub use markdown::{write_document, write_markdown};

/// Metrics of the interaction with the AV, as in the paper's studies.
const REACTION_METRICS: &[&str] = &["aav-collision", "aav-ttc"];
/// Metrics of the realism protocol: those of the paper's table 2, and the smallest displacement over
/// rollouts.
const REALISM_METRICS: &[&str] = &["aav-collision", "aav-ttc", "ade", "min-ade", "kinematic-likelihood"];

/// Metrics of planners, of which those without a value are left out.
const PLANNER_METRICS: &[&str] = &["av-score", "av-score-partial", "av-at-fault-collisions", "aav-collision"];

/// Metrics of agents around AVs that follow the log.
const LOG_METRICS: &[&str] = &["ade", "aa-collision", "offroad", "aav-collision"];

/// Metrics of agents around fixed AVs.
const FIXED_AV_METRICS: &[&str] = &["aav-collision", "over-reaction"];

/// A table of a study.
struct StudyTable<'a> {
    title: Title,
    /// Heads of the texts after the simulator: of its variant, or of the values of axes.
    settings: Vec<&'a str>,
    heads: Vec<Head>,
    rows: Vec<StudyRow<'a>>,
}

/// The title of a table.
enum Title {
    /// The table shows the study.
    None,
    /// It shows this metric by replan interval.
    ByInterval(Column),
    /// It shows this metric by planner.
    ByPlanner(Column),
    /// It shows differences between variants and the unchanged simulator.
    Differences,
}

impl Title {
    /// Returns the title, if there is one, with the heads of columns and the space before a unit of a format.
    fn text(&self, head: fn(&Column) -> String, space: &str) -> Option<String> {
        Some(match self {
            Self::None => return None,
            Self::ByInterval(column) => {
                format!("{} by steps (of 0.1{space}s) between two plans", head(column))
            }
            Self::ByPlanner(column) => format!("{} by planner", head(column)),
            Self::Differences => "Difference to the same simulator as it is".to_owned(),
        })
    }
}

/// The head of a column of numbers.
enum Head {
    /// Number of steps between two plans.
    Interval(usize),
    /// A planner.
    Planner(String),
    /// A metric, in a protocol if there are several.
    Metric { protocol: Option<String>, column: Column },
}

/// The numbers of a simulator.
struct StudyRow<'a> {
    title: &'a str,
    marks: TableMarks,
    settings: Vec<&'a str>,
    cells: Vec<StudyCell>,
}

/// A number of a simulator.
struct StudyCell {
    column: Column,
    estimate: Option<Estimate>,
    /// Whether it is a difference to the unchanged simulator.
    is_difference: bool,
    /// Whether it is the best of its column: among all simulators, or among the variants of its own. Oracles
    /// are not ranked.
    is_best: bool,
}

impl StudyCell {
    fn of(summary: &Summary, simulator: &str, column: Column) -> Self {
        let estimates = summary.simulators.get(simulator).map(|s| &s.metrics);
        let estimate = estimates.and_then(|metrics| metrics.get(column.metric)).copied();
        Self { column, estimate, is_difference: false, is_best: false }
    }

    /// Returns the mean with the half width of its interval, if there are any.
    fn numbers(&self) -> Option<(f64, Option<f64>)> {
        let Estimate { mean, low, high, .. } = self.estimate?;
        Some((mean?, low.zip(high).map(|(low, high)| (high - low) / 2.0)))
    }

    /// Returns whether it is a difference whose interval leaves out 0.
    fn is_significant(&self) -> bool {
        let excludes_zero = |estimate: Estimate| {
            estimate.low.is_some_and(|low| low > 0.0) || estimate.high.is_some_and(|high| high < 0.0)
        };
        self.is_difference && self.estimate.is_some_and(excludes_zero)
    }
}

/// Returns the tables of a study.
fn tables<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    let mut tables = match results.study.kind {
        StudyKind::Replan => by_interval(results, style),
        StudyKind::Realism | StudyKind::Errors => by_protocol(results, style),
        StudyKind::Guards => by_variant(results, style),
        StudyKind::Planners => by_planner(results, style),
        StudyKind::Axes => by_value(results, style),
    };
    // Scores of planners are better for one planner than for another, not for one simulator.
    if style.bold && results.study.kind != StudyKind::Planners {
        tables.iter_mut().for_each(mark_best);
    }
    tables
}

/// Returns the tables of texts of a study.
fn text_tables(results: &StudyResults) -> Vec<planners::TextTable> {
    let mut tables = planners::rank_tables(results);
    tables.extend(errors::error_tables(results));
    tables
}

/// Returns the columns of a member of a study; the user's own metrics come last.
fn columns(results: &StudyResults, member: &Member, style: TableStyle<'_>) -> Vec<Column> {
    if let Some(chosen) = style.chosen() {
        return chosen;
    }
    let of = |ids: &[&'static str]| -> Vec<Column> { ids.iter().map(|id| Column::benchmark(id)).collect() };
    let usual = match results.study.kind {
        StudyKind::Replan | StudyKind::Realism if member.protocol.as_deref() == Some("realism") => {
            of(REALISM_METRICS)
        }
        StudyKind::Replan | StudyKind::Realism => of(REACTION_METRICS),
        StudyKind::Guards => MAIN_COLUMNS.to_vec(),
        // A planner may drive the AV of some members.
        StudyKind::Axes => {
            let planners = of(PLANNER_METRICS).into_iter().filter(|c| c.has_numbers(&results.summaries));
            Column::with(planners.collect(), MAIN_COLUMNS)
        }
        StudyKind::Planners if member.planner.is_none() => of(FIXED_AV_METRICS),
        StudyKind::Planners => of(PLANNER_METRICS),
        StudyKind::Errors => of(LOG_METRICS),
    };
    Column::with(Column::with(usual, &Column::own(&results.summaries)), style.also)
}

/// Returns the members of a study with their results.
fn members(results: &StudyResults) -> impl Iterator<Item = (&Member, &Summary)> {
    results.study.members.iter().zip(&results.summaries)
}

/// One table per metric: simulators by replan interval.
fn by_interval<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    let all: Vec<(&Member, &Summary)> = members(results).collect();
    let Some((member, _)) = all.first() else { return Vec::new() };
    let columns = columns(results, member, style).into_iter();
    let head = |member: &Member, _| Head::Interval(member.replan_steps.unwrap_or_default());
    let table = |column| {
        let shown = all.iter().map(|(member, summary)| (*member, *summary, column));
        by_member(shown, Title::ByInterval(column), head)
    };
    columns.map(table).collect()
}

/// One table per metric: simulators by planner. Metrics without a value are left out, and so are fixed AVs,
/// which no planner drives.
fn by_planner<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    let planned: Vec<(&Member, &Summary)> =
        members(results).filter(|(member, _)| member.planner.is_some()).collect();
    let Some((member, _)) = planned.first() else { return Vec::new() };
    let columns = columns(results, member, style).into_iter();
    let head = |member: &Member, _| Head::Planner(member.label.clone());
    let tables = columns.map(|column| {
        let shown = planned.iter().map(|(member, summary)| (*member, *summary, column));
        by_member(shown, Title::ByPlanner(column), head)
    });
    let has_numbers = |table: &StudyTable<'_>| {
        table.rows.iter().flat_map(|row| &row.cells).any(|cell| cell.numbers().is_some())
    };
    tables.filter(has_numbers).collect()
}

/// Returns a table with a row per simulator, and a column per member and metric.
fn by_member<'a>(
    shown: impl Iterator<Item = (&'a Member, &'a Summary, Column)>,
    title: Title,
    head: impl Fn(&Member, Column) -> Head,
) -> StudyTable<'a> {
    let shown: Vec<_> = shown.collect();
    let row = |(id, title, simulator): (&str, &'a str, &SimulatorSummary)| StudyRow {
        title,
        marks: simulator.marks(),
        settings: Vec::new(),
        cells: shown.iter().map(|(_, summary, column)| StudyCell::of(summary, id, *column)).collect(),
    };
    StudyTable {
        title,
        settings: Vec::new(),
        heads: shown.iter().map(|(member, _, column)| head(member, *column)).collect(),
        rows: shown.first().into_iter().flat_map(|(_, first, _)| first.order()).map(row).collect(),
    }
}

/// One table: simulators by metrics of both protocols.
fn by_protocol<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    if results.summaries.is_empty() {
        return Vec::new();
    }
    let shown = members(results).flat_map(|(member, summary)| {
        columns(results, member, style).into_iter().map(move |column| (member, summary, column))
    });
    let head = |member: &Member, column| Head::Metric { protocol: member.protocol.clone(), column };
    vec![by_member(shown, Title::None, head)]
}

/// Two tables: the metrics of all variants, and their differences from the unchanged simulators.
fn by_variant<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    let Some((member, first)) = members(results).next() else { return Vec::new() };
    let columns = columns(results, member, style);
    let (mut values, mut differences) = (Vec::new(), Vec::new());
    for (original, title, simulator) in first.order() {
        for (i, (member, summary)) in members(results).enumerate() {
            for (id, _) in member.originals.iter().filter(|(_, of)| *of == original) {
                let row = |cells: Vec<StudyCell>| StudyRow {
                    title,
                    marks: simulator.marks(),
                    settings: vec![member.label.as_str()],
                    cells,
                };
                values.push(row(columns.iter().map(|column| StudyCell::of(summary, id, *column)).collect()));
                let Some(found) = difference(results, i, id) else { continue };
                let cell = |column: &Column| {
                    let paired = found.comparison.as_ref().and_then(|c| c.metrics.get(column.metric));
                    let estimate = paired.map(|paired| paired.difference);
                    StudyCell { column: *column, estimate, is_difference: true, is_best: false }
                };
                differences.push(row(columns.iter().map(cell).collect()));
            }
        }
    }
    let table = |title, rows| {
        let heads = columns.iter().map(|column| Head::Metric { protocol: None, column: *column });
        StudyTable { title, settings: vec!["Variant"], heads: heads.collect(), rows }
    };
    let mut tables = vec![table(Title::None, values)];
    if !differences.is_empty() {
        tables.push(table(Title::Differences, differences));
    }
    tables
}

/// One table: the metrics of every simulator at the values of the axes. Simulators that differ are rows
/// anyway.
fn by_value<'a>(results: &'a StudyResults, style: TableStyle<'_>) -> Vec<StudyTable<'a>> {
    let Some((first, _)) = members(results).next() else { return Vec::new() };
    let columns = columns(results, first, style);
    let shown = |member: &'a Member| member.axes.iter().filter(|at| at.key != "models");
    let mut ids: Vec<&str> = Vec::new();
    for (id, ..) in members(results).flat_map(|(_, summary)| summary.order()) {
        if !ids.contains(&id) {
            ids.push(id);
        }
    }
    let row = |id: &str, (member, summary): (&'a Member, &'a Summary)| {
        let (id, title, simulator) = summary.order().find(|(other, ..)| *other == id)?;
        let cells = columns.iter().map(|column| StudyCell::of(summary, id, *column)).collect();
        let settings = shown(member).map(|at| at.value.as_str()).collect();
        Some(StudyRow { title, marks: simulator.marks(), settings, cells })
    };
    let heads = columns.iter().map(|column| Head::Metric { protocol: None, column: *column });
    vec![StudyTable {
        title: Title::None,
        settings: shown(first).map(|at| at.key.as_str()).collect(),
        heads: heads.collect(),
        rows: ids.iter().flat_map(|id| members(results).filter_map(|at| row(id, at))).collect(),
    }]
}

fn difference<'a>(results: &'a StudyResults, member: usize, simulator: &str) -> Option<&'a Difference> {
    results.differences.iter().find(|d| d.member == member && d.simulator == simulator)
}

/// Marks the best numbers of every column.
fn mark_best(table: &mut StudyTable<'_>) {
    for c in 0..table.heads.len() {
        let ranked = |row: &StudyRow<'_>| {
            row.cells[c].numbers().filter(|_| !row.marks.is_oracle() && !row.cells[c].is_difference)
        };
        let best: Vec<bool> = table
            .rows
            .iter()
            .map(|row| {
                // Variants compete with those of their own simulator.
                let rivals = table.rows.iter().filter(|r| table.settings.is_empty() || r.title == row.title);
                let numbers: Vec<f64> = rivals.filter_map(ranked).map(|(mean, _)| mean).collect();
                let column = &row.cells[c].column;
                let own = ranked(row).map(|(mean, _)| column.number(mean));
                own.is_some() && own == best_number(column, &numbers)
            })
            .collect();
        for (row, is_best) in table.rows.iter_mut().zip(best) {
            row.cells[c].is_best = is_best;
        }
    }
}
