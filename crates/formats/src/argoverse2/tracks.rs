//! Table of tracks: one row per track and time step.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_scene::AgentState;

use crate::error::{Cause, FormatError};
use crate::table::{Batch, Leaf, TableReader, View};

const COLUMNS: [&str; 14] = [
    "track_id",
    "object_type",
    "object_category",
    "timestep",
    "position_x",
    "position_y",
    "heading",
    "velocity_x",
    "velocity_y",
    "scenario_id",
    "start_timestamp",
    "end_timestamp",
    "num_timestamps",
    "focal_track_id",
];
/// Maximum number of rows of a scenario: 110 time steps of nine thousand tracks.
const MAX_ROWS: usize = 1_000_000;
/// Maximum number of tracks of a scenario: usual scenarios have some hundred, and each track has all frames,
/// however few rows it has.
const MAX_TRACKS: usize = 10_000;
/// Upper bound of time step indices; a scenario has 110 time steps.
const MAX_STEPS: u32 = 10_000;
const NANOSECONDS_PER_SECOND: f64 = 1e9;

#[derive(Default)]
pub(super) struct Tracks {
    pub(super) scenario_id: String,
    /// Id of the focal track, which forecasters predict.
    pub(super) focal: Option<String>,
    /// Duration of a time step in seconds, if the file contains it.
    pub(super) step: Option<f64>,
    /// Tracks in order of first appearance.
    pub(super) tracks: Vec<Track>,
    /// Index in `tracks` by id.
    index: BTreeMap<String, usize>,
    rows: usize,
}

pub(super) struct Track {
    pub(super) id: String,
    pub(super) object_type: String,
    /// Category: 0 fragment, 1 unscored, 2 scored, 3 focal.
    pub(super) category: u32,
    /// States by time step.
    pub(super) states: BTreeMap<u32, AgentState>,
}

impl Tracks {
    pub(super) fn read(path: &Path) -> Result<Self, FormatError> {
        let mut table = TableReader::open(path)?;
        table.only(COLUMNS);
        let mut tracks = Self::default();
        while let Some(batch) = table.next_batch() {
            let read = tracks.add(&batch?);
            read.map_err(|cause| FormatError::file(path, cause).at(0))?;
        }
        if tracks.rows == 0 {
            let cause = Cause::value("the table", "empty", "rows of tracks; fetch the file again");
            return Err(FormatError::file(path, cause).at(0));
        }
        Ok(tracks)
    }

    /// Reads the id of the scenario from the first row of a table; `None` if this fails.
    pub(super) fn scenario_id(path: &Path) -> Option<String> {
        let mut table = TableReader::open(path).ok()?;
        table.only(["scenario_id"]);
        let batch = table.next_batch()?.ok()?;
        let ids = View::need(&batch, "scenario_id", Leaf::Text, 0).ok()?;
        (batch.num_rows() > 0).then(|| ids.text(0).map(str::to_owned)).flatten()
    }

    fn add(&mut self, batch: &Batch) -> Result<(), Cause> {
        if self.rows + batch.num_rows() > MAX_ROWS {
            return Err(Cause::value("the number of rows", "more than a million", "one scenario"));
        }
        let [ids, types, scenarios] =
            ["track_id", "object_type", "scenario_id"].map(|name| View::need(batch, name, Leaf::Text, 0));
        let (ids, types, scenarios) = (ids?, types?, scenarios?);
        let steps = View::need(batch, "timestep", Leaf::Whole, 0)?;
        let categories = View::find(batch, "object_category", Leaf::Whole, 0)?;
        let [x, y, heading] =
            ["position_x", "position_y", "heading"].map(|name| View::need(batch, name, Leaf::Number, 0));
        let (x, y, heading) = (x?, y?, heading?);
        let [vx, vy] = ["velocity_x", "velocity_y"].map(|name| View::find(batch, name, Leaf::Number, 0));
        let (vx, vy) = (vx?, vy?);
        for cell in 0..batch.num_rows() {
            let row = self.rows;
            let number = |view: &View| {
                let v = view.number(cell);
                let found = v.map_or("null".to_owned(), |v| v.to_string());
                v.filter(|v| v.is_finite()).ok_or_else(|| wrong(view, row, found, "a finite number"))
            };
            let text = |view: &'_ View| -> Result<String, Cause> {
                Ok(view.text(cell).ok_or_else(|| wrong(view, row, "null", "a text"))?.to_owned())
            };
            // Only velocities may be unknown.
            let velocity =
                |view: &Option<View>| view.as_ref().and_then(|v| v.number(cell)).unwrap_or(f64::NAN);
            let state = AgentState {
                x: number(&x)?,
                y: number(&y)?,
                heading: number(&heading)?,
                vx: velocity(&vx),
                vy: velocity(&vy),
            };
            if row == 0 {
                self.scenario_id = text(&scenarios)?;
                self.read_scenario_attributes(batch)?;
            } else if scenarios.text(cell) != Some(&self.scenario_id) {
                let found = scenarios.text(cell).map_or("null".to_owned(), |t| format!("`{t}`"));
                let expected = format!("`{}` as in row 0: one scenario in a file", self.scenario_id);
                return Err(wrong(&scenarios, row, found, expected));
            }
            let step = steps.whole(cell).filter(|s| *s < MAX_STEPS);
            let step = step.ok_or_else(|| {
                let found = steps.whole(cell).map_or("null".to_owned(), |s| s.to_string());
                wrong(&steps, row, found, "an index such as 0 to 109")
            })?;
            let id = text(&ids)?;
            let track = match self.index.get(&id) {
                Some(&i) => i,
                None if self.tracks.len() >= MAX_TRACKS => {
                    let expected = format!("one of at most {MAX_TRACKS} tracks of one scenario");
                    return Err(wrong(&ids, row, format!("`{id}`, one too many"), expected));
                }
                None => {
                    let category = categories.as_ref().and_then(|c| c.whole(cell)).unwrap_or(0);
                    let states = BTreeMap::new();
                    self.tracks.push(Track { id: id.clone(), object_type: text(&types)?, category, states });
                    self.index.insert(id.clone(), self.tracks.len() - 1);
                    self.tracks.len() - 1
                }
            };
            if self.tracks[track].states.insert(step, state).is_some() {
                let expected = format!("one row per time step of track `{id}`");
                return Err(wrong(&steps, row, format!("{step} a second time"), expected));
            }
            self.rows += 1;
        }
        Ok(())
    }

    /// Reads the attributes of the scenario from the first row.
    fn read_scenario_attributes(&mut self, batch: &Batch) -> Result<(), Cause> {
        let focal = View::find(batch, "focal_track_id", Leaf::Text, 0)?;
        self.focal = focal.and_then(|f| f.text(0).map(str::to_owned));
        let [from, to, count] = ["start_timestamp", "end_timestamp", "num_timestamps"]
            .map(|name| View::find(batch, name, Leaf::Number, 0).map(|v| v.and_then(|v| v.number(0))));
        if let (Some(from), Some(to), Some(count)) = (from?, to?, count?) {
            self.step = Some((to - from) / NANOSECONDS_PER_SECOND / (count - 1.0));
        }
        Ok(())
    }
}

fn wrong(column: &View, row: usize, value: impl std::fmt::Display, expected: impl Into<String>) -> Cause {
    Cause::value(format!("`{}` in row {row}", column.name()), value, expected)
}
