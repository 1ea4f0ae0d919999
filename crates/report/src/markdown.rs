//! Markdown tables, aligned for terminals.

use std::io::{self, Write};

use reactsim_evaluation::{Estimate, TableMarks};

use super::table::{self, Column, Division, Line};
use super::terminal::is_unsafe;
use super::{Run, TableStyle};

pub(super) fn export(runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let columns = style.columns_of(runs);
    let lines = table::lines(runs, None);
    write_table(out, &columns, &lines, style.bold)?;
    let of_av = Column::of_av(runs);
    if !of_av.is_empty() {
        writeln!(out, "\n{}:\n", escape(&table::av_title(runs)))?;
        write_table(out, &of_av, &table::av_lines(runs), style.bold)?;
    }
    for division in Division::ALL {
        for part in division.parts(runs) {
            let lines = table::lines(runs, Some((division, &part)));
            let n = lines.iter().map(|l| l.scenarios).max().unwrap_or(0);
            let title = capital(&escape(&division.title(&part)));
            writeln!(out, "\n{title} ({}):\n", table::count(n, "scenario"))?;
            write_table(out, &columns, &lines, style.bold)?;
        }
    }
    writeln!(out)?;
    legend(out, lines.iter().map(|l| l.marks))?;
    if let Some(note) = table::fewer(runs, &columns, None) {
        writeln!(out, "{note}.")?;
    }
    for provenance in table::provenances(runs) {
        writeln!(out, "{}.", escape(&provenance))?;
    }
    Ok(())
}

/// Writes a table with the heads of its columns; the best numbers are bold on request.
pub(super) fn write_table(
    out: &mut dyn Write,
    columns: &[Column],
    lines: &[Line<'_>],
    bold: bool,
) -> io::Result<()> {
    let with_run = lines.iter().any(|l| l.run.is_some());
    let with_av = lines.iter().any(|l| l.av.is_some());
    let with_failed = lines.iter().any(|l| l.failed > 0);
    let mut head: Vec<String> = Vec::new();
    head.extend(with_run.then(|| "Run".to_owned()));
    head.extend(with_av.then(|| "AV".to_owned()));
    head.push("Method".to_owned());
    head.extend(columns.iter().map(Column::head));
    head.extend(with_failed.then(|| "Failed".to_owned()));
    let texts = 1 + usize::from(with_run) + usize::from(with_av);
    let best = table::best_of_columns(columns, lines);
    let row = |(i, line): (usize, &Line<'_>)| {
        let mut row: Vec<String> = line.run.into_iter().chain(line.av).map(escape).collect();
        row.push(method(line.title, line.marks));
        row.extend(columns.iter().zip(&best).map(|(column, best)| {
            let text = cell(column, line.metrics.get(column.metric));
            if bold && best[i] { format!("**{text}**") } else { text }
        }));
        row.extend(with_failed.then(|| line.failed.to_string()));
        row
    };
    write_aligned(out, &head, lines.iter().enumerate().map(row), texts)
}

/// Writes the explanation of the marks of a table.
pub(super) fn legend(out: &mut dyn Write, of: impl IntoIterator<Item = TableMarks>) -> io::Result<()> {
    for text in marks(of) {
        writeln!(out, "{text}.")?;
    }
    writeln!(out, "{NUMBERS}.")
}

/// Explanation of the numbers in tables, which stands below them.
pub(super) const NUMBERS: &str =
    "Means over scenarios ± half the width of the 95 % bootstrap interval; ↓ less is better, ↑ more is";

/// Returns the marks of these simulators with their explanations.
pub(super) fn marks(of: impl IntoIterator<Item = TableMarks>) -> Vec<String> {
    table::marked(of).map(|mark| format!("{} {}", mark.sign(), mark.meaning())).collect()
}

/// Returns the name of a simulator with its marks.
pub(super) fn method(title: &str, marks: TableMarks) -> String {
    format!("{} {}", escape(title), marks.signs()).trim_end().to_owned()
}

/// Writes rows as long as the head as a table. The first `texts` columns hold text and are left-aligned, the
/// others numbers.
pub(super) fn write_aligned(
    out: &mut dyn Write,
    head: &[impl ToString],
    rows: impl IntoIterator<Item = Vec<String>>,
    texts: usize,
) -> io::Result<()> {
    let head = head.iter().map(ToString::to_string).collect();
    let rows: Vec<Vec<String>> = std::iter::once(head).chain(rows).collect();
    let widths: Vec<usize> =
        (0..rows[0].len()).map(|c| rows.iter().map(|r| r[c].chars().count()).max().unwrap_or(0)).collect();
    for (i, row) in rows.iter().enumerate() {
        let cells: Vec<String> = row.iter().enumerate().map(|(c, t)| pad(t, widths[c], c >= texts)).collect();
        writeln!(out, "| {} |", cells.join(" | "))?;
        if i == 0 {
            let rule = |(c, w): (usize, &usize)| {
                if c >= texts { format!("{}:", "-".repeat(w + 1)) } else { "-".repeat(w + 2) }
            };
            writeln!(out, "|{}|", widths.iter().enumerate().map(rule).collect::<Vec<_>>().join("|"))?;
        }
    }
    Ok(())
}

fn pad(text: &str, width: usize, right: bool) -> String {
    let space = " ".repeat(width - text.chars().count());
    if right { format!("{space}{text}") } else { format!("{text}{space}") }
}

/// Formats a mean with half the width of its interval, if it has one; a dash if no scenario has a value.
pub(super) fn cell(column: &Column, estimate: Option<&Estimate>) -> String {
    estimate_text(estimate, |value| column.number(value))
}

/// As [`cell`], with numbers formatted by `number`.
pub(super) fn estimate_text(estimate: Option<&Estimate>, number: impl Fn(f64) -> String) -> String {
    match estimate {
        Some(Estimate { mean: Some(mean), low: Some(low), high: Some(high), .. }) => {
            format!("{} ±{}", number(*mean), number((high - low) / 2.0))
        }
        Some(Estimate { mean: Some(mean), .. }) => number(*mean),
        _ => "–".to_owned(),
    }
}

pub(super) fn capital(text: &str) -> String {
    let mut chars = text.chars();
    chars.next().map_or_else(String::new, |c| c.to_uppercase().chain(chars).collect())
}

/// Escapes foreign text for Markdown. Control characters become spaces.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\\' | '`' | '*' | '|' | '<' | '>' | '[' | ']' => out.extend(['\\', c]),
            // Underscores inside words are no emphasis; names of runs and simulators stay readable.
            c if is_unsafe(c) => out.push(' '),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_cannot_break_the_table() {
        assert_eq!(escape("a|b\nc*"), "a\\|b c\\*");
    }
}
