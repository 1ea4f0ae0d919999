//! Presentation of results: tables, pictures and the page. It never decides what is run.

pub mod animation;
pub mod birdseye;
pub mod blocks;
pub mod comparison;
mod csv;
pub mod curation_tables;
mod json;
mod latex;
pub mod leaderboard;
mod long;
mod markdown;
pub mod paper;
mod parquet;
pub mod page;
pub mod study_tables;
mod style;
mod table;
pub mod tensorboard;
pub mod terminal;
pub mod training_curves;
pub mod training_paths;
pub mod verification;
pub mod web;
pub mod wrap;
pub mod wosac_tables;

use std::io::{self, Write};

use reactsim_evaluation::Summary;

pub use markdown::escape as markdown_text;
pub use style::TableStyle;
pub use table::{COLUMNS, Column, Division, MAIN_COLUMNS};

/// The result of one run, with a name that distinguishes it from others.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Name of the run folder; empty for a run without one.
    pub name: &'a str,
    /// Result of the run.
    pub summary: &'a Summary,
}

/// An output format of results.
#[derive(Debug)]
pub struct Exporter {
    /// Name on the command line.
    pub id: &'static str,
    write: fn(&[Run<'_>], TableStyle<'_>, &mut dyn Write) -> io::Result<()>,
}

impl Exporter {
    /// Writes the results of runs. Formats for programs ignore what concerns the appearance.
    ///
    /// # Errors
    /// If `out` cannot be written.
    pub fn export(&self, runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()> {
        (self.write)(runs, style, out)
    }
}

/// All output formats.
pub const EXPORTERS: &[Exporter] = &[
    Exporter { id: "markdown", write: markdown::export },
    Exporter { id: "csv", write: csv::export },
    Exporter { id: "json", write: json::export },
    Exporter { id: "parquet", write: parquet::export },
    Exporter { id: "latex", write: latex::export },
];

/// Returns the output format with this name.
pub fn exporter(id: &str) -> Option<&'static Exporter> {
    EXPORTERS.iter().find(|exporter| exporter.id == id)
}
