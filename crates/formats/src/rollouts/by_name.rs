//! Random access to rollouts.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use reactsim_geometry::Vec2;

use super::{KIND, RolloutRecord, Rows, VERSION};
use crate::error::{Cause, FormatError};
use crate::states;
use crate::table::{Leaf, TableReader, View};

/// Rollout file with random access by scenario, simulator and rollout index. Only the names and one row group
/// are in memory.
pub struct ByName {
    path: PathBuf,
    origin: Option<Vec2>,
    /// Row group and row, by scenario, simulator and rollout index.
    places: BTreeMap<(String, String, u32), (usize, usize)>,
    state: Mutex<State>,
}

struct State {
    table: TableReader,
    /// The row group that was read most recently, with its index.
    last: Option<(usize, Rows)>,
}

impl ByName {
    /// Opens a file and reads the names of its rollouts. If a name occurs several times, the first rollout
    /// counts.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be read, is damaged, or does not contain rollouts.
    pub fn open(path: &Path) -> Result<Self, FormatError> {
        let mut table = TableReader::open(path)?;
        table.expect(KIND, VERSION)?;
        let refuse = |cause| FormatError::file(path, cause);
        let origin = states::table_origin(&table).map_err(refuse)?;
        let mut places = BTreeMap::new();
        for group in 0..table.groups() {
            let batch = table.group(group, &["scenario_id", "simulator", "rollout"])?;
            let scenario = View::need(&batch, "scenario_id", Leaf::Text, 0).map_err(refuse)?;
            let simulator = View::need(&batch, "simulator", Leaf::Text, 0).map_err(refuse)?;
            let rollout = View::find(&batch, "rollout", Leaf::Whole, 0).map_err(refuse)?;
            for row in 0..batch.num_rows() {
                // Rows without a name are ignored.
                let Some((scenario, simulator)) = scenario.text(row).zip(simulator.text(row)) else {
                    continue;
                };
                let rollout = rollout.as_ref().and_then(|r| r.whole(row)).unwrap_or(0);
                let name = (scenario.to_owned(), simulator.to_owned(), rollout);
                places.entry(name).or_insert((group, row));
            }
        }
        Ok(Self { path: path.to_owned(), origin, places, state: Mutex::new(State { table, last: None }) })
    }

    /// Returns whether the file contains this rollout.
    pub fn has(&self, scenario: &str, simulator: &str, rollout: u32) -> bool {
        self.place(scenario, simulator, rollout).is_some()
    }

    fn place(&self, scenario: &str, simulator: &str, rollout: u32) -> Option<(usize, usize)> {
        self.places.get(&(scenario.to_owned(), simulator.to_owned(), rollout)).copied()
    }

    /// Reads a rollout; `None` if the file does not contain it.
    ///
    /// # Errors
    /// [`FormatError`] if the file has changed or cannot be read any more, or if the rollout is damaged.
    pub fn read(
        &self,
        scenario: &str,
        simulator: &str,
        rollout: u32,
    ) -> Result<Option<RolloutRecord>, FormatError> {
        let Some((group, row)) = self.place(scenario, simulator, rollout) else { return Ok(None) };
        let refuse = |cause| FormatError::file(&self.path, cause);
        let mut state = self.state.lock();
        if state.last.as_ref().is_none_or(|(last, _)| *last != group) {
            let batch = state.table.group(group, &[])?;
            state.last = Some((group, Rows::new(&batch).map_err(refuse)?));
        }
        let rows = state.last.as_ref().map(|(_, rows)| rows).filter(|rows| row < rows.len);
        let record = rows.map(|rows| rows.record(row, self.origin).map_err(refuse)).transpose()?;
        match record {
            Some(found) if found.scenario_id == scenario && found.simulator == simulator => Ok(Some(found)),
            _ => Err(refuse(Cause::value(
                "the content of the file",
                format!("another rollout in place of `{scenario}`, `{simulator}`"),
                "the content at opening; the file has changed since",
            ))),
        }
    }
}
