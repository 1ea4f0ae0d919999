//! Rollouts in Parquet: one row per scenario, simulator and rollout. Described in `docs/files.md`.

mod by_name;
mod pickle;

use std::path::{Path, PathBuf};

pub use by_name::ByName;
pub use pickle::to_pickle;

use super::certificates::STATE_VALUES;
use super::error::{Cause, FormatError};
use super::states::{self, StateColumns};
use super::table::{Batch, Column, Leaf, TableReader, TableWriter, Value, View};
use reactsim_geometry::Vec2;
use reactsim_scene::Frame;

/// Value of `reactsim.format`.
const KIND: &str = "reactsim-rollouts";
const VERSION: u32 = 1;
/// Number of rollouts in a row group.
const GROUP_SIZE: usize = 16;

/// Tracks of the agents of one scenario, moved by one simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct RolloutRecord {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Name of the simulator.
    pub simulator: String,
    /// Index of the rollout, from 0.
    pub rollout: u32,
    /// Origin of the coordinates in the world frame: (0, 0) for world coordinates, `None` for the scenario's
    /// origin.
    pub origin: Option<Vec2>,
    /// Ids of the agents, including the AV.
    pub agent_ids: Vec<String>,
    /// States of each agent at the steps after the current frame, as many for each; `None` where absent.
    /// Unknown velocities are NaN.
    pub tracks: Vec<Vec<Frame>>,
}

impl RolloutRecord {
    /// Returns the tracks in the frame of a scenario with this origin.
    pub fn tracks_in(&self, origin: Vec2) -> Vec<Vec<Frame>> {
        let translate = |frame: &Frame| frame.map(|s| states::translate(s, self.origin, origin));
        self.tracks.iter().map(|t| t.iter().map(translate).collect()).collect()
    }
}

/// Writer of rollouts. The file gets its final name in [`Writer::finish`]; dropping the writer before leaves
/// no file.
pub struct Writer {
    table: TableWriter,
}

impl Writer {
    /// Starts a file under a temporary name in the same folder.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be created.
    pub fn create(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let mut columns = vec![
            Column::new("scenario_id", Leaf::Text, 0, false),
            Column::new("simulator", Leaf::Text, 0, false),
            Column::new("rollout", Leaf::Whole, 0, false),
            Column::new("origin_x", Leaf::Number, 0, true),
            Column::new("origin_y", Leaf::Number, 0, true),
            Column::new("agent_id", Leaf::Text, 1, false),
        ];
        columns.extend(states::COLUMNS.map(|name| Column::new(name, Leaf::Number, 2, true)));
        Ok(Self { table: TableWriter::create(path.as_ref(), (KIND, VERSION), GROUP_SIZE, columns)? })
    }

    /// Adds a rollout.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be written.
    pub fn write(&mut self, record: &RolloutRecord) -> Result<(), FormatError> {
        let t = &mut self.table;
        t.column("scenario_id").push(Value::Text(&record.scenario_id));
        t.column("simulator").push(Value::Text(&record.simulator));
        t.column("rollout").push(Value::Whole(record.rollout));
        t.column("origin_x").push(Value::from(record.origin.map(|o| o.x)));
        t.column("origin_y").push(Value::from(record.origin.map(|o| o.y)));
        t.column("agent_id").list(record.agent_ids.iter().map(|id| Value::Text(id)));
        for (column, value) in states::COLUMNS.into_iter().zip(STATE_VALUES) {
            let known = |f: &Frame| Value::from(f.as_ref().map(value).filter(|v| !v.is_nan()));
            t.column(column).lists(record.tracks.iter().map(|track| track.iter().map(known)));
        }
        self.table.end_row()
    }

    /// Completes the file and gives it its final name.
    ///
    /// # Errors
    /// [`FormatError`] if the file cannot be written.
    pub fn finish(self) -> Result<(), FormatError> {
        self.table.finish()
    }
}

/// Reads rollouts of this or any other program in file order. An error with [`FormatError::ends_file`] is the
/// last item; other errors concern one row.
///
/// # Errors
/// [`FormatError`] if the file is not a Parquet file or does not contain rollouts.
pub fn read(path: impl AsRef<Path>) -> Result<Reader, FormatError> {
    let path = path.as_ref();
    let table = TableReader::open(path)?;
    table.expect(KIND, VERSION)?;
    let origin = states::table_origin(&table).map_err(|cause| FormatError::file(path, cause))?;
    Ok(Reader { path: path.to_owned(), table, origin, rows: None, record: 0 })
}

/// Iterator over the rollouts of a file.
pub struct Reader {
    path: PathBuf,
    table: TableReader,
    origin: Option<Vec2>,
    /// Current rows and the index of the next one.
    rows: Option<(Rows, usize)>,
    record: u64,
}

/// Columns of the rows in memory.
struct Rows {
    len: usize,
    scenario_id: View,
    simulator: View,
    rollout: Option<View>,
    origin: Option<[View; 2]>,
    agent_id: View,
    states: StateColumns,
}

impl Iterator for Reader {
    type Item = Result<RolloutRecord, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some((rows, next)) = &mut self.rows
                && *next < rows.len
            {
                let (row, record) = (*next, self.record);
                *next += 1;
                self.record += 1;
                let scenario = rows.scenario_id.text(row).map(str::to_owned);
                let refuse = |cause| FormatError::record(&self.path, record, scenario, cause);
                return Some(rows.record(row, self.origin).map_err(refuse));
            }
            let rows = match self.table.next_batch()? {
                Ok(batch) => Rows::new(&batch).map_err(|cause| FormatError::file(&self.path, cause)),
                Err(error) => Err(error),
            };
            match rows {
                Ok(rows) => self.rows = Some((rows, 0)),
                Err(error) => {
                    self.rows = None;
                    self.table.end();
                    return Some(Err(error.at(self.record)));
                }
            }
        }
    }
}

impl Rows {
    fn new(batch: &Batch) -> Result<Self, Cause> {
        let x = View::find(batch, "origin_x", Leaf::Number, 0)?;
        let y = View::find(batch, "origin_y", Leaf::Number, 0)?;
        Ok(Self {
            len: batch.num_rows(),
            scenario_id: View::need(batch, "scenario_id", Leaf::Text, 0)?,
            simulator: View::need(batch, "simulator", Leaf::Text, 0)?,
            rollout: View::find(batch, "rollout", Leaf::Whole, 0)?,
            origin: x.zip(y).map(|(x, y)| [x, y]),
            agent_id: View::need(batch, "agent_id", Leaf::Text, 1)?,
            states: StateColumns::find(batch, 2)?,
        })
    }

    fn record(&self, row: usize, origin: Option<Vec2>) -> Result<RolloutRecord, Cause> {
        let text = |view: &View| match view.text(row) {
            Some(text) => Ok(text.to_owned()),
            None => Err(Cause::value(format!("`{}`", view.name()), "null", "a text")),
        };
        let ids = self.agent_id.range(0, row);
        let mut agent_ids = Vec::with_capacity(ids.len());
        let mut tracks = Vec::with_capacity(ids.len());
        for (cell, ranges) in ids.clone().zip(self.states.inner(row, ids.len())?) {
            let id = self.agent_id.text(cell).unwrap_or_default();
            let steps =
                tracks.first().map_or_else(|| states::steps(&ranges), |first: &Vec<Frame>| Ok(first.len()));
            tracks.push(self.states.frames(&format!("agent `{id}`: "), &ranges, steps?)?);
            agent_ids.push(id.to_owned());
        }
        let origin = match &self.origin {
            None => origin,
            Some([x, y]) => x.number(row).zip(y.number(row)).map(|(x, y)| Vec2::new(x, y)),
        };
        if let Some(o) = origin.filter(|o| !(o.x.is_finite() && o.y.is_finite())) {
            return Err(Cause::value("`origin_x`, `origin_y`", format!("({}, {})", o.x, o.y), "finite"));
        }
        Ok(RolloutRecord {
            scenario_id: text(&self.scenario_id)?,
            simulator: text(&self.simulator)?,
            rollout: self.rollout.as_ref().and_then(|v| v.whole(row)).unwrap_or(0),
            origin,
            agent_ids,
            tracks,
        })
    }
}
