//! LaTeX with booktabs, in the layout of the paper's main table.

use std::io::{self, Write};

use super::table::{self, Column, Line};
use super::{Exporter, Run};
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

    fn export(&self, runs: &[Run<'_>], also: &[Column], out: &mut dyn Write) -> io::Result<()> {
        let summaries: Vec<_> = runs.iter().map(|r| r.summary).collect();
        let columns = Column::used(&summaries, also);
        let lines = table::lines(runs);
        let several = runs.len() > 1;
        writeln!(out, "\\begin{{table}}[t]")?;
        for run in runs {
            let name = if several { format!("{}: ", escape(run.name)) } else { String::new() };
            writeln!(out, "  % {name}{}", escape(&table::provenance(run)))?;
        }
        writeln!(
            out,
            "  \\caption{{Results with half widths of 95\\,\\% bootstrap intervals over scenarios. \
             $\\dagger$ is shown the log's future.}}"
        )?;
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
            writeln!(out, "    {} \\\\", row(&columns, line))?;
        }
        writeln!(out, "    \\bottomrule\n  \\end{{tabular}}\n\\end{{table}}")
    }
}

fn head(column: &Column) -> String {
    let arrow = if column.kind().1 { "$\\downarrow$" } else { "$\\uparrow$" };
    let unit = column.unit().map(|u| format!(" ({})", escape(u))).unwrap_or_default();
    format!("{} {arrow}{unit}", escape(column.title()))
}

fn row(columns: &[Column], line: &Line<'_>) -> String {
    let mut cells: Vec<String> = line.run.map(escape).into_iter().collect();
    cells.push(format!(
        "{}{}",
        escape(line.title),
        match line.access {
            Access::Blind => "",
            Access::BlindByMessage => "$^\\ddagger$",
            Access::Ids => "$^\\S$",
            Access::Oracle => "$^\\dagger$",
        }
    ));
    cells.extend(columns.iter().map(|c| match line.metrics.get(c.metric) {
        Some(Estimate { mean: Some(mean), low: Some(low), high: Some(high), .. }) => {
            format!("{} {{\\scriptsize $\\pm${}}}", c.number(*mean), c.number((high - low) / 2.0))
        }
        Some(Estimate { mean: Some(mean), .. }) => c.number(*mean),
        _ => "--".to_owned(),
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
