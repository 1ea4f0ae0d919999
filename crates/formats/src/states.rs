//! Tracks in Parquet files of any program, and their coordinate frame.

use std::ops::Range;

use reactsim_geometry::Vec2;
use reactsim_scene::{AgentState, Frame, Length};

use super::error::Cause;
use super::table::{Batch, FRAME, Leaf, TableReader, View};

/// Returns the origin of a coordinate frame given by name: (0, 0) for world coordinates, `None` (the
/// scenario's own origin) for scenario coordinates. `field` names the frame's field in errors.
pub(super) fn origin(field: &str, frame: Option<&str>) -> Result<Option<Vec2>, Cause> {
    match frame {
        None | Some("world") => Ok(Some(Vec2::zeros())),
        Some("scenario") => Ok(None),
        Some(other) => Err(Cause::schema(field, format!("`{other}`"), "`world` or `scenario`")),
    }
}

/// Like [`origin`], with the frame from a Parquet file's metadata.
pub(super) fn table_origin(table: &TableReader) -> Result<Option<Vec2>, Cause> {
    origin(&format!("`{FRAME}` in the file's metadata"), table.key(FRAME))
}

/// Translates a state with coordinates relative to `from` into the frame of a scenario with origin `to`.
pub(super) fn translate(state: AgentState, from: Option<Vec2>, to: Vec2) -> AgentState {
    match from {
        // With equal origins the state stays bit-identical.
        Some(from) if from != to => {
            let by = from - to;
            AgentState { x: state.x + by.x, y: state.y + by.y, ..state }
        }
        _ => state,
    }
}

/// Columns x, y, heading and the optional vx, vy.
pub(super) struct StateColumns {
    views: [Option<View>; 5],
}

pub(super) const COLUMNS: [&str; 5] = ["x", "y", "heading", "vx", "vy"];

impl StateColumns {
    /// Finds the columns, as lists of nesting depth `depth`.
    pub(super) fn find(batch: &Batch, depth: usize) -> Result<Self, Cause> {
        let [x, y, heading, vx, vy] = COLUMNS;
        let need = |name| View::need(batch, name, Leaf::Number, depth).map(Some);
        let find = |name| View::find(batch, name, Leaf::Number, depth);
        Ok(Self { views: [need(x)?, need(y)?, need(heading)?, find(vx)?, find(vy)?] })
    }

    /// Returns the range that `find` gives for each column, `None` for missing columns.
    pub(super) fn ranges(&self, find: impl Fn(&View) -> Range<usize>) -> [Option<Range<usize>>; 5] {
        self.views.each_ref().map(|view| view.as_ref().map(&find))
    }

    /// Returns the inner lists of a row, per column; there must be `expected` of them.
    pub(super) fn inner(&self, row: usize, expected: usize) -> Result<Vec<[Option<Range<usize>>; 5]>, Cause> {
        let outer = self.ranges(|v| v.range(0, row));
        for (name, range) in COLUMNS.iter().zip(&outer) {
            if let Some(range) = range.as_ref().filter(|r| r.len() != expected) {
                let found = format!("{} tracks", range.len());
                return Err(Cause::value(format!("`{name}`"), found, format!("{expected} tracks")));
            }
        }
        let list = |i: usize| self.ranges(|v| v.range(1, v.range(0, row).start + i));
        Ok((0..expected).map(list).collect())
    }

    /// Reads the frames in one list of each column; there must be `expected` of them. Null or NaN in x, y and
    /// heading means absent; null or NaN in vx and vy means unknown.
    pub(super) fn frames(
        &self,
        track: &str,
        ranges: &[Option<Range<usize>>; 5],
        expected: usize,
    ) -> Result<Vec<Frame>, Cause> {
        for (name, range) in COLUMNS.iter().zip(ranges) {
            if let Some(range) = range.as_ref().filter(|r| r.len() != expected) {
                let found = format!("{} steps", range.len());
                return Err(Cause::value(format!("{track}{name}"), found, format!("{expected} steps")));
            }
        }
        let value = |f: usize, k: usize| self.views[k].as_ref()?.number(ranges[k].as_ref()?.start + f);
        let values = |f: usize| std::array::from_fn(|k| value(f, k).unwrap_or(f64::NAN));
        (0..expected).map(|f| frame(track, f, values(f))).collect()
    }
}

/// Returns the number of steps of the lists of one track, which is that of the first one.
pub(super) fn steps(ranges: &[Option<Range<usize>>; 5]) -> Result<usize, Cause> {
    check_steps(ranges.iter().flatten().next().map_or(0, Range::len))
}

/// Refuses numbers of steps that no scenario has.
pub(super) fn check_steps(count: usize) -> Result<usize, Cause> {
    if (1..=Length::MAX_FUTURE).contains(&count) {
        return Ok(count);
    }
    let expected = format!("1 to {} steps", Length::MAX_FUTURE);
    Err(Cause::value("the length of `x`", format!("{count} steps"), expected))
}

/// Builds the frame at index `f` from x, y, heading, vx, vy.
pub(super) fn frame(track: &str, f: usize, values: [f64; 5]) -> Result<Frame, Cause> {
    if let Some(k) = values.iter().position(|v| v.is_infinite()) {
        let field = format!("{track}{} at step {}", COLUMNS[k], f + 1);
        return Err(Cause::value(field, values[k], "a finite number"));
    }
    let [x, y, heading, vx, vy] = values;
    match [x, y, heading].iter().filter(|v| v.is_nan()).count() {
        0 => Ok(Some(AgentState { x, y, heading, vx, vy })),
        3 => Ok(None),
        _ => {
            let field = format!("{track}x, y, heading at step {}", f + 1);
            Err(Cause::value(field, "partly missing", "all three given or all three missing"))
        }
    }
}
