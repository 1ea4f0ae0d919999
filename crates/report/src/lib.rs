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
pub trait Exporter: Sync {
    /// Returns the name on the command line.
    fn id(&self) -> &'static str;

    /// Returns a description of one line.
    fn title(&self) -> &'static str;

    /// Writes the results of runs. Formats for programs ignore what concerns the appearance.
    ///
    /// # Errors
    /// If `out` cannot be written.
    fn export(&self, runs: &[Run<'_>], style: TableStyle<'_>, out: &mut dyn Write) -> io::Result<()>;
}

/// All output formats.
pub const EXPORTERS: &[&dyn Exporter] =
    &[&markdown::Markdown, &csv::Csv, &json::Json, &parquet::Parquet, &latex::Latex];

/// Returns the output format with this name.
pub fn exporter(id: &str) -> Option<&'static dyn Exporter> {
    EXPORTERS.iter().copied().find(|e| e.id() == id)
}
