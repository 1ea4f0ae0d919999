//! Tracks in Parquet that any program may have written, and the frame that their coordinates are in.

use std::ops::Range;

use super::error::Cause;
use super::table::{FRAME, Leaf, TableReader, View};
use crate::geometry::Vec2;
use crate::scene::{AgentState, Frame};

/// What a stated frame means as an origin: world coordinates are relative to (0, 0), scenario coordinates to the
/// scenario's own origin (`None`).
pub(super) fn origin(what: &str, frame: Option<&str>) -> Result<Option<Vec2>, Cause> {
    match frame {
        None | Some("world") => Ok(Some(Vec2::zeros())),
        Some("scenario") => Ok(None),
        Some(other) => Err(Cause::schema(what, format!("`{other}`"), "`world` or `scenario`")),
    }
}

/// As [`origin`], of a Parquet file.
pub(super) fn table_origin(table: &TableReader) -> Result<Option<Vec2>, Cause> {
    origin(&format!("`{FRAME}` in the file's metadata"), table.key(FRAME))
}

/// A state in the frame of a scenario, from one whose coordinates are relative to `from`.
pub(super) fn moved(state: AgentState, from: Option<Vec2>, to: Vec2) -> AgentState {
    match from {
        // Equal origins move nothing, not even by a rounding error.
        Some(from) if from != to => {
            let by = from - to;
            AgentState { x: state.x + by.x, y: state.y + by.y, ..state }
        }
        _ => state,
    }
}

/// The columns x, y, heading and the optional vx, vy, as lists nested so deep.
pub(super) struct States {
    views: [Option<View>; 5],
}

/// Names of the columns.
const NAMES: [&str; 5] = ["x", "y", "heading", "vx", "vy"];

impl States {
    pub(super) fn find(batch: &arrow_array::RecordBatch, depth: usize) -> Result<Self, Cause> {
        let mut views = [const { None }; 5];
        for (k, view) in views.iter_mut().enumerate() {
            *view = if k < 3 {
                Some(View::need(batch, NAMES[k], Leaf::Number, depth)?)
            } else {
                View::find(batch, NAMES[k], Leaf::Number, depth)?
            };
        }
        Ok(Self { views })
    }

    /// The lists of each column that `find` gives; `None` for columns that are missing.
    pub(super) fn ranges(&self, find: impl Fn(&View) -> Range<usize>) -> [Option<Range<usize>>; 5] {
        let mut ranges = [const { None }; 5];
        for (range, view) in ranges.iter_mut().zip(&self.views) {
            *range = view.as_ref().map(&find);
        }
        ranges
    }

    /// The lists inside a list, per column, which must be so many.
    pub(super) fn inner(&self, row: usize, expected: usize) -> Result<Vec<[Option<Range<usize>>; 5]>, Cause> {
        let outer = self.ranges(|v| v.range(0, row));
        for (name, range) in NAMES.iter().zip(&outer) {
            if let Some(range) = range.as_ref().filter(|r| r.len() != expected) {
                let found = format!("{} tracks", range.len());
                return Err(Cause::value(format!("`{name}`"), found, format!("{expected} tracks")));
            }
        }
        let list = |i: usize| {
            let mut ranges = [const { None }; 5];
            for (k, range) in ranges.iter_mut().enumerate() {
                *range = match (&self.views[k], &outer[k]) {
                    (Some(view), Some(outer)) => Some(view.range(1, outer.start + i)),
                    _ => None,
                };
            }
            ranges
        };
        Ok((0..expected).map(list).collect())
    }

    /// The frames in a list of each column, which must be so many. Null or NaN in x, y and heading means absent; null or NaN
    /// velocities are unknown.
    pub(super) fn frames(
        &self,
        track: &str,
        ranges: &[Option<Range<usize>>; 5],
        expected: usize,
    ) -> Result<Vec<Frame>, Cause> {
        for (name, range) in NAMES.iter().zip(ranges) {
            if let Some(range) = range.as_ref().filter(|r| r.len() != expected) {
                let found = format!("{} steps", range.len());
                return Err(Cause::value(format!("{track}{name}"), found, format!("{expected} steps")));
            }
        }
        let mut frames = Vec::with_capacity(expected);
        for f in 0..expected {
            let value = |k: usize| match (&self.views[k], &ranges[k]) {
                (Some(view), Some(range)) => view.number(range.start + f).unwrap_or(f64::NAN),
                _ => f64::NAN,
            };
            frames.push(frame(track, f, [value(0), value(1), value(2), value(3), value(4)])?);
        }
        Ok(frames)
    }
}

/// One frame from x, y, heading, vx, vy.
pub(super) fn frame(track: &str, f: usize, values: [f64; 5]) -> Result<Frame, Cause> {
    if let Some(k) = values.iter().position(|v| v.is_infinite()) {
        let field = format!("{track}{} at step {}", NAMES[k], f + 1);
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
