//! What people read: tables and pictures. Knows results; never decides what is run.

pub mod animation;
pub mod birdseye;
pub mod blocks;
pub mod comparison;
mod csv;
pub mod curation_charts;
pub mod curation_tables;
mod json;
mod latex;
pub mod leaderboard;
mod long;
mod markdown;
mod parquet;
pub mod page;
pub mod realism_charts;
pub mod realism_tables;
pub mod study_tables;
mod table;
pub mod training_curves;
pub mod verification;

use std::io::{self, Write};

use crate::evaluation::Summary;

pub use table::{COLUMNS, Column};

/// The result of one run, with a name that tells it from others.
#[derive(Clone, Copy, Debug)]
pub struct Run<'a> {
    /// Name of the run folder; empty for a run without one.
    pub name: &'a str,
    /// Its result.
    pub summary: &'a Summary,
}

/// A form in which results are given.
pub trait Exporter: Sync {
    /// The name on the command line.
    fn id(&self) -> &'static str;

    /// One line for people.
    fn title(&self) -> &'static str;

    /// Writes the results of runs. `also`: columns that tables have besides the usual ones; forms that hold every metric do not need them.
    ///
    /// # Errors
    /// When `out` can not be written.
    fn export(&self, runs: &[Run<'_>], also: &[Column], out: &mut dyn Write) -> io::Result<()>;
}

/// All forms.
pub const EXPORTERS: &[&dyn Exporter] =
    &[&markdown::Markdown, &csv::Csv, &json::Json, &parquet::Parquet, &latex::Latex];

/// The form with this name.
pub fn exporter(id: &str) -> Option<&'static dyn Exporter> {
    EXPORTERS.iter().copied().find(|e| e.id() == id)
}
