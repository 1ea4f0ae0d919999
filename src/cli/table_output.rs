//! Output of the tables of runs: on a terminal in its width, else as Markdown.

use std::io::{self, IsTerminal};
use std::path::Path;

use clap::builder::PossibleValuesParser;
use clap::{Args, ValueEnum};
use console::Term;

use super::also::ExtraColumns;
use super::write_result;
use crate::report::terminal::{self, TerminalStyle};
use crate::report::{Column, Division, EXPORTERS, Run, exporter};

/// Format for terminals.
const TERMINAL: &str = "terminal";
/// Format for files and pipes.
const MARKDOWN: &str = "markdown";
/// Width of tables for terminals that are written to something else.
const DEFAULT_WIDTH: usize = 80;

/// How tables are printed.
#[derive(Debug, Args)]
pub(super) struct TableArgs {
    /// On a terminal: also a table per category of deviation or per difficulty of the conflict
    #[arg(long, value_name = "PARTS")]
    by: Option<Parts>,
    #[command(flatten)]
    also: ExtraColumns,
}

/// Parts of the scenarios that get tables of their own.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(super) enum Parts {
    /// Longitudinal, lateral and directional deviations
    Category,
    /// Easy, medium and hard conflicts
    Difficulty,
}

impl TableArgs {
    /// Returns the requested columns.
    pub(super) fn columns(&self) -> &[Column] {
        self.also.columns()
    }

    /// Returns the requested additional columns, for the table that a run folder keeps.
    pub(super) fn also(&self) -> &ExtraColumns {
        &self.also
    }

    /// Writes the table of runs to a file or to stdout. `format`: terminal on a terminal and markdown elsewhere
    /// if it is absent. `below` is appended to tables for people.
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
                Some(exporter) => exporter.export(runs, self.columns(), out)?,
                None => terminal::write(runs, self.style(is_terminal), out)?,
            }
            match format {
                TERMINAL | MARKDOWN => out.write_all(below.as_bytes()),
                _ => Ok(()),
            }
        })
    }

    fn style(&self, is_terminal: bool) -> TerminalStyle<'_> {
        let size = Term::stdout().size_checked().filter(|_| is_terminal);
        TerminalStyle {
            width: size.map_or(DEFAULT_WIDTH, |(_, columns)| usize::from(columns)),
            coloured: is_terminal && console::colors_enabled(),
            by: self.by.map(|parts| match parts {
                Parts::Category => Division::Category,
                Parts::Difficulty => Division::Difficulty,
            }),
            also: self.columns(),
        }
    }
}

/// Returns the names of all formats of tables, and of `others`.
pub(super) fn formats<const N: usize>(others: [&'static str; N]) -> PossibleValuesParser {
    let tables = [TERMINAL].into_iter().chain(EXPORTERS.iter().map(|e| e.id()));
    PossibleValuesParser::new(tables.chain(others))
}
