//! Studies as Markdown.

use std::io::{self, Write};

use reactsim_evaluation::{SimulatorSummary, StudyKind, StudyResults};

use super::planners::{TextTable, notes, pair_table};
use super::{Head, StudyCell, StudyTable, Title, columns, errors, members, tables, text_tables};
use crate::comparison::signed;
use crate::markdown::{capital, cell, escape, legend, method, write_aligned};
use crate::table::{Column, fewer, program, provenance, scenarios};
use crate::{Run, TableStyle, wosac_tables};

/// Writes the tables of a study as Markdown.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_markdown(results: &StudyResults, style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    write_tables(results, style, out)?;
    let runs: Vec<Run<'_>> =
        members(results).map(|(member, summary)| Run { name: &member.folder, summary }).collect();
    let of_member = |(member, _)| columns(results, member, style);
    let shown = members(results).flat_map(of_member).collect::<Vec<_>>();
    if let Some(note) = fewer(&runs, &Column::with(Vec::new(), &shown), None) {
        writeln!(out, "{note}.")?;
    }
    writeln!(out)?;
    for run in &runs {
        writeln!(out, "- `{}`: {}", run.name, escape(&provenance(run)))?;
    }
    Ok(())
}

/// Writes the tables of a study for a document, with benchmark, number of scenarios and program below them.
/// With `columns`, it writes the values of these columns only, without differences and ranks.
///
/// # Errors
/// When `out` cannot be written.
pub fn write_document(results: &StudyResults, columns: &[Column], out: &mut dyn Write) -> io::Result<()> {
    if columns.is_empty() {
        write_tables(results, TableStyle::default(), out)?;
    } else {
        let style = TableStyle { columns, ..TableStyle::default() };
        let all = tables(results, style);
        write_values(all.iter().filter(|table| !matches!(table.title, Title::Differences)), out)?;
        write_legend(results, out)?;
    }
    let Some(summary) = results.summaries.first() else { return Ok(()) };
    let run = &summary.provenance.run;
    let benchmark = run.benchmark.as_ref().map(|b| format!("{b}, ")).unwrap_or_default();
    let run_scenarios = scenarios(&summary.provenance);
    writeln!(out, "\n{}.", escape(&format!("{benchmark}{run_scenarios}, {}", program(run))))
}

/// Writes the tables and their legend.
fn write_tables(results: &StudyResults, style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let put = |table: TextTable, out: &mut dyn Write| {
        writeln!(out, "{}:\n", table.title)?;
        write_aligned(out, &table.head, table.rows, table.texts)
    };
    // Whether one planner is better than another is the question.
    if let Some(table) = pair_table(results) {
        put(table, out)?;
        writeln!(out)?;
    }
    write_values(tables(results, style).iter(), out)?;
    for table in text_tables(results) {
        writeln!(out)?;
        put(table, out)?;
    }
    write_legend(results, out)?;
    if results.study.kind == StudyKind::Guards {
        writeln!(
            out,
            "Differences are paired, scenario by scenario; bold where the interval, which need not be \
             symmetric, leaves 0 out."
        )?;
    }
    if let Some(found) = &results.planners {
        for note in notes(found) {
            writeln!(out, "{note}")?;
        }
    }
    if results.errors.is_some() {
        writeln!(out, "{}", errors::NOTE)?;
    }
    if !results.realism.is_empty() {
        writeln!(out)?;
        wosac_tables::write_simulators(&results.realism, out)?;
    }
    Ok(())
}

/// Writes tables of numbers under their titles.
fn write_values<'a, 'b: 'a>(
    tables: impl Iterator<Item = &'a StudyTable<'b>>,
    out: &mut dyn Write,
) -> io::Result<()> {
    for (i, table) in tables.enumerate() {
        if i > 0 {
            writeln!(out)?;
        }
        if let Some(title) = table.title.text(Column::head, " ") {
            writeln!(out, "{title}:\n")?;
        }
        write_table(table, out)?;
    }
    Ok(())
}

/// Writes the meaning of the marks in the tables.
fn write_legend(results: &StudyResults, out: &mut dyn Write) -> io::Result<()> {
    writeln!(out)?;
    let all = results.summaries.iter().flat_map(|s| s.simulators.values());
    legend(out, all.map(SimulatorSummary::marks))
}

fn write_table(table: &StudyTable<'_>, out: &mut dyn Write) -> io::Result<()> {
    let texts = std::iter::once(&"Method").chain(&table.settings).map(|text| (*text).to_owned());
    let head: Vec<String> = texts.chain(table.heads.iter().map(head)).collect();
    let rows = table.rows.iter().map(|row| {
        let texts =
            std::iter::once(method(row.title, row.marks)).chain(row.settings.iter().map(|t| escape(t)));
        texts.chain(row.cells.iter().map(text)).collect()
    });
    write_aligned(out, &head, rows, 1 + table.settings.len())
}

fn head(head: &Head) -> String {
    match head {
        Head::Interval(steps) => steps.to_string(),
        Head::Planner(planner) => planner.clone(),
        Head::Metric { protocol: Some(protocol), column } => {
            format!("{}: {}", capital(protocol), column.head())
        }
        Head::Metric { protocol: None, column } => column.head(),
    }
}

fn text(number: &StudyCell) -> String {
    let StudyCell { column, estimate, is_difference, is_best } = number;
    let text = match (is_difference, number.numbers()) {
        (true, Some((mean, Some(half)))) => format!("{} ±{}", signed(column, mean), column.number(half)),
        (true, Some((mean, None))) => signed(column, mean),
        _ => cell(column, estimate.as_ref()),
    };
    if *is_best || number.is_significant() { format!("**{text}**") } else { text }
}
