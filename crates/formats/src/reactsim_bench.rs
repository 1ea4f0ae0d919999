//! The data set of ReactSim-Bench: deviated AVs of nuPlan scenarios in Python pickles, one file each, named
//! `<map_name>_<scene_token>_<sample_token>.pkl`.
//!
//! What is inside a file is not documented. The trajectory is found by its content: every array is tested
//! under every [`Layout`], and the one under which the AVs of all files continue their logs is taken. The
//! frames of the logs are found by the tokens of the file names.

mod content;
mod decide;
mod layout;
mod logs;
mod sidecar;
mod tally;
#[cfg(test)]
mod tests;
mod track;

pub use super::nuplan::{Pose, check_maps};
pub use decide::{Decided, Undecided, decide, measure};
pub use layout::{Axes, Choice, Layout, Point, Sample, Slot, Windows};
pub use logs::{BenchName, IndexedLog, Located, files_in, locate};
pub use sidecar::{category_of_path, sidecar};
pub use tally::Tally;

use std::path::Path;

use reactsim_scene::{AgentState, Deviation};

use super::deviations::{KIND, VERSION};
use super::error::FormatError;
use super::table::{Column, FRAME, Leaf, TableWriter, Value};

/// Number of deviations in a row group.
const GROUP_SIZE: usize = 64;

/// Deviated AV of a file.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Token of the current frame, which is the id of the scenario.
    pub scenario_id: String,
    /// Category, if known.
    pub category: Option<Deviation>,
    /// Name and digest of the file.
    pub source: (String, String),
    /// States at steps 1 to 80 in world coordinates.
    pub track: Vec<AgentState>,
}

/// Writes deviations in world coordinates, with a description of how they were made.
///
/// # Errors
/// [`FormatError`] if the file cannot be written.
pub fn write(path: &Path, deviations: &[Imported], about: String) -> Result<(), FormatError> {
    let text = |name, nullable| Column::new(name, Leaf::Text, 0, nullable);
    let mut columns = vec![text("scenario_id", false), text("category", true)];
    columns.extend([text("source", false), text("source_digest", false)]);
    columns.extend(["x", "y", "heading"].map(|name| Column::new(name, Leaf::Number, 1, false)));
    let mut table = TableWriter::create(path, (KIND, VERSION), GROUP_SIZE, columns)?;
    for one in deviations {
        table.column("scenario_id").push(Value::Text(&one.scenario_id));
        table.column("category").push(one.category.map(Deviation::name).into());
        table.column("source").push(Value::Text(&one.source.0));
        table.column("source_digest").push(Value::Text(&one.source.1));
        for (name, value) in
            [("x", (|s| s.x) as fn(&AgentState) -> f64), ("y", |s| s.y), ("heading", |s| s.heading)]
        {
            table.column(name).list(one.track.iter().map(|state| Value::Number(value(state))));
        }
        table.end_row()?;
    }
    table.add_metadata(FRAME, "world".to_owned());
    table.add_metadata("reactsim.import", about);
    table.finish()
}
