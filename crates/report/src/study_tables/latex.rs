//! Studies as LaTeX.

use std::io::{self, Write};

use reactsim_evaluation::StudyResults;

use super::planners::{PAIRS, TextTable, pair_table};
use super::{Head, StudyCell, StudyTable, Title, members, tables, text_tables};
use crate::comparison::signed;
use crate::latex::{begin_table, column_head, durations, escape, mark, meanings, number, write_tabular};
use crate::table::provenance;
use crate::{Run, TableStyle};

/// Writes the tables of a study as LaTeX, one below the other in one `table`; needs `\usepackage{booktabs}`.
///
/// # Errors
/// If `out` cannot be written.
pub fn write_latex(results: &StudyResults, style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let comments = members(results).map(|(member, summary)| {
        let run = Run { name: &member.folder, summary };
        format!("{}: {}", member.folder, provenance(&run))
    });
    let tables = tables(results, style);
    let pairs = pair_table(results);
    let caption = caption(results, &tables, pairs.is_some(), style);
    begin_table(&comments.collect::<Vec<_>>(), &caption, style.label, out)?;
    if let Some(table) = pairs {
        writeln!(out, "  {}\\\\[2pt]", escape(table.title))?;
        write_texts(&table, out)?;
        writeln!(out, "\n  \\medskip")?;
    }
    for (i, table) in tables.iter().enumerate() {
        if i > 0 {
            writeln!(out, "\n  \\medskip")?;
        }
        if let Some(title) = table.title.text(column_head, "\\,") {
            writeln!(out, "  {title}\\\\[2pt]")?;
        }
        write_table(table, out)?;
    }
    for table in text_tables(results) {
        writeln!(out, "\n  \\medskip\n  {}\\\\[2pt]", escape(table.title))?;
        write_texts(&table, out)?;
    }
    writeln!(out, "\\end{{table}}")
}

fn write_table(table: &StudyTable<'_>, out: &mut dyn Write) -> io::Result<()> {
    let align = format!("{}{}", "l".repeat(1 + table.settings.len()), "c".repeat(table.heads.len()));
    let texts = std::iter::once(&"Method").chain(&table.settings).map(|head| escape(head));
    let heads: Vec<String> = texts.chain(table.heads.iter().map(head)).collect();
    let rows = table.rows.iter().enumerate().map(|(i, row)| {
        let before = i.checked_sub(1).map(|before| &table.rows[before]);
        // Simulators with several variants are separated, and so are oracles from the others.
        let is_apart = before.is_some_and(|before| match table.settings.is_empty() {
            true => before.marks.is_oracle() && !row.marks.is_oracle(),
            false => before.title != row.title,
        });
        let method = format!("{}{}", escape(row.title), mark(row.marks));
        let texts = std::iter::once(method).chain(row.settings.iter().map(|text| escape(text)));
        (is_apart, texts.chain(row.cells.iter().map(cell)).collect())
    });
    write_tabular(out, &align, &heads, rows)
}

fn write_texts(table: &TextTable, out: &mut dyn Write) -> io::Result<()> {
    let escaped = |cells: &Vec<String>| cells.iter().map(|text| escape(text)).collect::<Vec<_>>();
    let align = format!("l{}", "c".repeat(table.head.len() - 1));
    write_tabular(out, &align, &escaped(&table.head), table.rows.iter().map(|row| (false, escaped(row))))
}

fn head(head: &Head) -> String {
    match head {
        Head::Interval(steps) => steps.to_string(),
        Head::Planner(planner) => escape(planner),
        Head::Metric { protocol: Some(protocol), column } => {
            format!("{} ({})", column_head(column), escape(protocol))
        }
        Head::Metric { protocol: None, column } => column_head(column),
    }
}

fn cell(cell: &StudyCell) -> String {
    let Some((mean, half)) = cell.numbers() else { return "--".to_owned() };
    let mean = if cell.is_difference {
        format!("${}$", signed(&cell.column, mean))
    } else {
        cell.column.number(mean)
    };
    number(&mean, half.map(|half| cell.column.number(half)).as_deref(), cell.is_best || cell.is_significant())
}

/// Returns the requested caption, or the usual one with durations other than that of the benchmark and the
/// meaning of the marks that occur.
fn caption(
    results: &StudyResults,
    tables: &[StudyTable<'_>],
    has_pairs: bool,
    style: TableStyle<'_>,
) -> String {
    if let Some(caption) = style.caption {
        return escape(caption);
    }
    let mut text = "Means with half widths of 95\\,\\% bootstrap intervals over scenarios.".to_owned();
    if style.bold {
        text.push_str(" Bold: the best number of a column, oracles excepted.");
    }
    if tables.iter().any(|table| matches!(table.title, Title::Differences)) {
        text.push_str(" Differences are paired; bold where the interval leaves 0 out.");
    }
    if has_pairs {
        text.push_str(&format!(" {}", escape(PAIRS)));
    }
    text.push_str(&durations(results.summaries.iter()));
    let rows = tables.iter().flat_map(|table| &table.rows);
    text.push_str(&meanings(rows.map(|row| row.marks)));
    text
}
