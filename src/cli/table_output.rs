//! Output of the tables of runs: on a terminal in its width, else as Markdown.

use std::io::{self, IsTerminal};
use std::path::Path;

use anyhow::bail;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, ValueEnum};
use console::Term;

use super::output::write_result;
use crate::metrics::METRICS;
use crate::report::terminal::{self, TerminalStyle};
use crate::report::{Column, Division, EXPORTERS, Run, TableStyle, exporter};

/// Format for terminals.
const TERMINAL: &str = "terminal";
/// Format for files and pipes.
const MARKDOWN: &str = "markdown";
/// Width of tables for terminals that are written to something else.
const DEFAULT_WIDTH: usize = 80;

/// Settings of printed tables.
#[derive(Debug, Args)]
pub(super) struct TableArgs {
    /// On a terminal: also a table per category of deviation or per difficulty of the conflict
    #[arg(long, value_name = "PARTS")]
    by: Option<Parts>,
    #[command(flatten)]
    columns: ColumnArgs,
}

/// Columns of tables, and what marks their best numbers.
#[derive(Debug, Args)]
pub(super) struct ColumnArgs {
    /// Columns instead of the usual ones: metrics, separated by commas
    #[arg(long, value_name = "METRIC", value_delimiter = ',', hide_possible_values = true,
          value_parser = column())]
    columns: Vec<Column>,
    /// Additional table columns: metrics, separated by commas, such as log-clinging
    /// (`reactsim list metrics` names all)
    #[arg(long, value_name = "METRIC", value_delimiter = ',', hide_possible_values = true,
          value_parser = column())]
    also: Vec<Column>,
    /// In Markdown and LaTeX: print the best numbers among comparable runs in bold
    #[arg(long)]
    bold: bool,
    /// Caption of a LaTeX table
    #[arg(long, value_name = "TEXT")]
    caption: Option<String>,
    /// Label of a LaTeX table, such as tab:results
    #[arg(long, value_name = "LABEL")]
    label: Option<String>,
}

/// Parses the id of a metric; clap answers an unknown id with all ids and the most similar one.
fn column() -> impl TypedValueParser<Value = Column> {
    let ids = METRICS.iter().map(|m| m.spec().id);
    PossibleValuesParser::new(ids).try_map(|id| Column::of(&id).ok_or_else(|| format!("no metric `{id}`")))
}

/// Parts of the scenarios that get tables of their own.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum Parts {
    /// Longitudinal, lateral and directional deviations
    Category,
    /// Easy, medium and hard conflicts
    Difficulty,
}

impl ColumnArgs {
    /// Returns whether nothing was asked for.
    fn is_usual(&self) -> bool {
        let texts = self.caption.is_none() && self.label.is_none();
        self.columns.is_empty() && self.also.is_empty() && !self.bold && texts
    }

    /// Refuses options that this format has no use for; `with_columns` are the formats that have columns.
    pub(super) fn check(&self, format: &str, with_columns: &[&str]) -> anyhow::Result<()> {
        let uses = [
            ("--caption", self.caption.is_some(), &["latex"][..]),
            ("--label", self.label.is_some(), &["latex"]),
            ("--bold", self.bold, &["markdown", "latex"]),
            ("--columns", !self.columns.is_empty(), with_columns),
            ("--also", !self.also.is_empty(), with_columns),
        ];
        for (option, is_given, formats) in uses {
            if is_given && !formats.contains(&format) {
                let formats = formats.join(" or ");
                bail!("{option} has no effect on {format}: leave it out, or give --format {formats}");
            }
        }
        Ok(())
    }

    /// Returns what the tables show.
    pub(super) fn style(&self) -> TableStyle<'_> {
        TableStyle {
            columns: &self.columns,
            also: &self.also,
            bold: self.bold,
            caption: self.caption.as_deref(),
            label: self.label.as_deref(),
        }
    }
}

impl TableArgs {
    /// Returns whether nothing was asked for.
    pub(super) fn is_usual(&self) -> bool {
        self.by.is_none() && self.columns.is_usual()
    }

    /// Refuses options that this format has no use for.
    pub(super) fn check(&self, format: Option<&str>) -> anyhow::Result<()> {
        let with_columns = [TERMINAL, MARKDOWN, "csv", "parquet", "latex"];
        self.columns.check(format.unwrap_or(MARKDOWN), &with_columns)
    }

    /// Returns what the tables show.
    pub(super) fn style(&self) -> TableStyle<'_> {
        self.columns.style()
    }

    /// Writes the table of runs to a file or to stdout. `format`: terminal on a terminal and markdown
    /// elsewhere if it is absent. `below` is appended to tables for people.
    pub(super) fn write(
        &self,
        runs: &[Run<'_>],
        format: Option<&str>,
        out: Option<&Path>,
        below: &str,
    ) -> anyhow::Result<()> {
        let is_terminal = out.is_none() && io::stdout().is_terminal();
        let default = if is_terminal { TERMINAL } else { MARKDOWN };
        let format = format.unwrap_or(default);
        write_result(out, |out| {
            match exporter(format) {
                Some(exporter) => exporter.export(runs, self.style(), out)?,
                None => terminal::write(runs, self.terminal_style(is_terminal), out)?,
            }
            match format {
                TERMINAL | MARKDOWN => out.write_all(below.as_bytes()),
                _ => Ok(()),
            }
        })
    }

    fn terminal_style(&self, is_terminal: bool) -> TerminalStyle<'_> {
        let size = Term::stdout().size_checked().filter(|_| is_terminal);
        TerminalStyle {
            width: size.map_or(DEFAULT_WIDTH, |(_, columns)| usize::from(columns)),
            coloured: is_terminal && console::colors_enabled(),
            by: self.by.map(|parts| match parts {
                Parts::Category => Division::Category,
                Parts::Difficulty => Division::Difficulty,
            }),
            table: self.style(),
        }
    }
}

/// Returns the names of all formats of tables, and of `others`.
pub(super) fn formats<const N: usize>(others: [&'static str; N]) -> PossibleValuesParser {
    let tables = [TERMINAL].into_iter().chain(EXPORTERS.iter().map(|exporter| exporter.id));
    PossibleValuesParser::new(tables.chain(others))
}
