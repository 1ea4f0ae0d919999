//! LaTeX with booktabs, in the layout of the paper's main table.

use std::collections::BTreeSet;
use std::io::{self, Write};

use reactsim_evaluation::{Access, Estimate, Mark, Summary, TableMarks};

use super::table::{self, Column, Line};
use super::terminal::is_unsafe;
use super::{Run, TableStyle};

pub(super) fn export(runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
    let columns = style.columns_of(runs);
    let lines = table::lines(runs, None);
    let best = table::best_of_columns(&columns, &lines);
    let texts: Vec<&str> = lines.first().map_or(vec!["Method"], |line| {
        let run = line.run.map(|_| "Run").into_iter().chain(line.av.map(|_| "AV"));
        run.chain(["Method"]).collect()
    });
    let caption = style.caption.map_or_else(|| caption(runs, &lines, style.bold), escape);
    let mut comments = table::provenances(runs);
    comments.extend(table::fewer(runs, &columns, None));
    begin_table(&comments, &caption, style.label, out)?;
    let align = format!("{}{}", "l".repeat(texts.len()), "c".repeat(columns.len()));
    let heads = texts.iter().map(|text| (*text).to_owned()).chain(columns.iter().map(column_head));
    let rows = lines.iter().enumerate().map(|(i, line)| {
        // The paper separates the oracles.
        let is_apart = i > 0 && lines[i - 1].marks.is_oracle() && !line.marks.is_oracle();
        let mut cells: Vec<String> = line.run.into_iter().chain(line.av).map(escape).collect();
        cells.push(format!("{}{}", escape(line.title), mark(line.marks)));
        cells.extend(columns.iter().zip(&best).map(|(column, best)| {
            let Some(Estimate { mean: Some(mean), low, high, .. }) = line.metrics.get(column.metric) else {
                return "--".to_owned();
            };
            let half = low.zip(*high).map(|(low, high)| column.number((high - low) / 2.0));
            number(&column.number(*mean), half.as_deref(), style.bold && best[i])
        }));
        (is_apart, cells)
    });
    write_tabular(out, &align, &heads.collect::<Vec<_>>(), rows)?;
    writeln!(out, "\\end{{table}}")
}

/// Writes a `tabular` with rows of LaTeX, each with whether a line sets it apart from the one above.
pub(super) fn write_tabular(
    out: &mut dyn Write,
    align: &str,
    head: &[String],
    rows: impl IntoIterator<Item = (bool, Vec<String>)>,
) -> io::Result<()> {
    writeln!(out, "  \\begin{{tabular}}{{{align}}}\n    \\toprule")?;
    writeln!(out, "    {} \\\\\n    \\midrule", head.join(" & "))?;
    for (is_apart, row) in rows {
        if is_apart {
            writeln!(out, "    \\midrule")?;
        }
        writeln!(out, "    {} \\\\", row.join(" & "))?;
    }
    writeln!(out, "    \\bottomrule\n  \\end{{tabular}}")
}

/// Begins a table with comments, caption and label.
pub(super) fn begin_table(
    comments: &[String],
    caption: &str,
    label: Option<&str>,
    out: &mut dyn Write,
) -> io::Result<()> {
    writeln!(out, "\\begin{{table}}[t]")?;
    for comment in comments {
        writeln!(out, "  % {}", escape(comment))?;
    }
    writeln!(out, "  \\caption{{{caption}}}")?;
    if let Some(label) = label {
        writeln!(out, "  \\label{{{}}}", label_text(label))?;
    }
    writeln!(out, "  \\centering\n  \\small")
}

/// Returns the head of a column: title, arrow towards better values, unit.
pub(super) fn column_head(column: &Column) -> String {
    let arrow = if column.kind().1 { "$\\downarrow$" } else { "$\\uparrow$" };
    let unit = column.unit().map(|u| format!(" ({})", escape(u))).unwrap_or_default();
    format!("{} {arrow}{unit}", escape(column.title()))
}

/// Returns the usual caption, with durations other than that of the benchmark and the meaning of the marks
/// that occur.
fn caption(runs: &[Run<'_>], lines: &[Line<'_>], bold: bool) -> String {
    let mut text = "Results with half widths of 95\\,\\% bootstrap intervals over scenarios.".to_owned();
    if bold {
        text.push_str(" Bold: the best simulator among comparable runs, oracles excepted.");
    }
    if let [run] = runs
        && let Some(planner) = run.summary.provenance.run.settings.planner()
    {
        text.extend([" The AV is driven by planner ", escape(planner).as_str(), "."]);
    }
    text.push_str(&durations(runs.iter().map(|run| run.summary)));
    text.push_str(&meanings(lines.iter().map(|line| line.marks)));
    text
}

/// Returns the durations of the scenarios of runs that differ from that of the benchmark, as sentences.
pub(super) fn durations<'a>(summaries: impl Iterator<Item = &'a Summary>) -> String {
    let durations: BTreeSet<String> = summaries.filter_map(|summary| summary.provenance.duration()).collect();
    durations.iter().map(|duration| format!(" Scenarios of {}.", escape(duration))).collect()
}

/// Returns the meaning of the marks of these simulators, as sentences.
pub(super) fn meanings(of: impl Iterator<Item = TableMarks>) -> String {
    table::marked(of).map(|mark| format!(" {} {}.", sign(mark), escape(mark.meaning()))).collect()
}

/// Returns the characters of a label that LaTeX takes: letters, digits and a few signs.
fn label_text(label: &str) -> String {
    label.chars().filter(|c| c.is_ascii_alphanumeric() || "-_:.+/".contains(*c)).collect()
}

/// Returns the signs behind the name of a simulator.
pub(super) fn mark(marks: TableMarks) -> String {
    marks.marks().map(sign).collect()
}

fn sign(mark: Mark) -> &'static str {
    match mark {
        Mark::Access(Access::Blind) => "",
        Mark::Access(Access::BlindByMessage) => "$^\\ddagger$",
        Mark::Access(Access::Ids) => "$^\\S$",
        Mark::Access(Access::Oracle) => "$^\\dagger$",
        Mark::Allowed => "$^\\P$",
    }
}

/// Returns a number with the half width of its interval, if it has one.
pub(super) fn number(mean: &str, half: Option<&str>, is_bold: bool) -> String {
    let mean = if is_bold { format!("\\textbf{{{mean}}}") } else { mean.to_owned() };
    half.map_or(mean.clone(), |half| format!("{mean} {{\\scriptsize $\\pm${half}}}"))
}

/// Escapes text for LaTeX.
pub(super) fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
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
    fn names_are_printed_as_they_are() {
        assert_eq!(escape("my_model & 50%"), "my\\_model \\& 50\\%");
    }
}
