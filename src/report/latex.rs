//! LaTeX with booktabs, in the layout of the paper's main table.

use std::io::{self, Write};

use super::table::{self, Column, Line};
use super::{Exporter, Run, TableStyle};
use crate::evaluation::{Access, Estimate};

/// The LaTeX format.
pub(super) struct Latex;

impl Exporter for Latex {
    fn id(&self) -> &'static str {
        "latex"
    }

    fn title(&self) -> &'static str {
        "the paper's main table; needs \\usepackage{booktabs}"
    }

    fn export(&self, runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
        let summaries: Vec<_> = runs.iter().map(|r| r.summary).collect();
        let columns = style.columns_of(&summaries);
        let lines = table::lines(runs);
        let best: Vec<Vec<bool>> = columns.iter().map(|column| table::best(column, &lines)).collect();
        let several = runs.len() > 1;
        writeln!(out, "\\begin{{table}}[t]")?;
        for run in runs {
            let name = if several { format!("{}: ", escape(run.name)) } else { String::new() };
            writeln!(out, "  % {name}{}", escape(&table::provenance(run)))?;
        }
        match style.caption {
            Some(caption) => writeln!(out, "  \\caption{{{}}}", escape(caption))?,
            None => writeln!(out, "  \\caption{{{}}}", caption(&lines, style.bold))?,
        }
        if let Some(label) = style.label {
            writeln!(out, "  \\label{{{}}}", label_text(label))?;
        }
        writeln!(out, "  \\centering\n  \\small")?;
        let texts = if several { "ll" } else { "l" };
        writeln!(out, "  \\begin{{tabular}}{{{texts}{}}}\n    \\toprule", "c".repeat(columns.len()))?;
        let heads: Vec<String> = columns.iter().map(head).collect();
        let first = if several { "Run & Method" } else { "Method" };
        writeln!(out, "    {first} & {} \\\\\n    \\midrule", heads.join(" & "))?;
        for (i, line) in lines.iter().enumerate() {
            // The paper separates the oracles.
            if i > 0 && lines[i - 1].access == Access::Oracle && line.access != Access::Oracle {
                writeln!(out, "    \\midrule")?;
            }
            let best: Vec<bool> = best.iter().map(|column| style.bold && column[i]).collect();
            writeln!(out, "    {} \\\\", row(&columns, line, &best))?;
        }
        writeln!(out, "    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}")
    }
}

fn head(column: &Column) -> String {
    let arrow = if column.kind().1 { "$\\downarrow$" } else { "$\\uparrow$" };
    let unit = column.unit().map(|u| format!(" ({})", escape(u))).unwrap_or_default();
    format!("{} {arrow}{unit}", escape(column.title()))
}

/// Returns the usual caption, with the meaning of the marks that occur.
fn caption(lines: &[Line<'_>], bold: bool) -> String {
    let mut text = "Results with half widths of 95\\,\\% bootstrap intervals over scenarios.".to_owned();
    if bold {
        text.push_str(" Bold: the best simulator among comparable runs, oracles excepted.");
    }
    let marked = Access::MARKED.into_iter().filter(|access| lines.iter().any(|line| line.access == *access));
    for access in marked {
        text.push_str(&format!(" {} {}.", mark(access), escape(access.meaning())));
    }
    text
}

/// Returns the characters of a label that LaTeX takes: letters, digits and a few signs.
fn label_text(label: &str) -> String {
    label.chars().filter(|c| c.is_ascii_alphanumeric() || "-_:.+/".contains(*c)).collect()
}

fn mark(access: Access) -> &'static str {
    match access {
        Access::Blind => "",
        Access::BlindByMessage => "$^\\ddagger$",
        Access::Ids => "$^\\S$",
        Access::Oracle => "$^\\dagger$",
    }
}

/// Returns the cells of a line; `best` says which of its numbers are bold.
fn row(columns: &[Column], line: &Line<'_>, best: &[bool]) -> String {
    let mut cells: Vec<String> = line.run.map(escape).into_iter().collect();
    cells.push(format!("{}{}", escape(line.title), mark(line.access)));
    cells.extend(columns.iter().zip(best).map(|(column, best)| {
        let Some(Estimate { mean: Some(mean), low, high, .. }) = line.metrics.get(column.metric) else {
            return "--".to_owned();
        };
        let number = column.number(*mean);
        let number = if *best { format!("\\textbf{{{number}}}") } else { number };
        match low.zip(*high) {
            Some((low, high)) => {
                format!("{number} {{\\scriptsize $\\pm${}}}", column.number((high - low) / 2.0))
            }
            None => number,
        }
    }));
    cells.join(" & ")
}

/// Escapes text for LaTeX.
fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' | '%' | '$' | '#' | '_' | '{' | '}' => out.extend(['\\', c]),
            '\\' => out.push_str("\\textbackslash{}"),
            '~' => out.push_str("\\textasciitilde{}"),
            '^' => out.push_str("\\textasciicircum{}"),
            c if c.is_control() => out.push(' '),
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
