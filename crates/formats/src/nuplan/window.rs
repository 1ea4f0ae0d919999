//! Rows of a log that become the frames of a scenario.

use reactsim_scene::{CURRENT, FRAMES, FUTURE};

use super::log::Log;
use crate::error::Cause;

/// Number of rows of the clock (20 Hz) per frame (10 Hz).
pub(super) const ROWS_PER_FRAME: usize = 2;
/// Valid time in microseconds between successive frames; a longer time means missing rows.
const FRAME_INTERVAL: std::ops::Range<i64> = 50_000..150_000;

/// Returns whether there are enough of all rows before and after a frame.
pub(super) fn fits(rows: usize, anchor: usize) -> bool {
    anchor >= ROWS_PER_FRAME * CURRENT && rows - anchor > ROWS_PER_FRAME * FUTURE
}

/// Returns the rows of the 91 frames around row `anchor`, counted without regard to time stamps.
///
/// # Errors
/// [`Cause`] if there are not enough rows, or if time jumps between them.
pub(super) fn rows(log: &Log, anchor: usize) -> Result<Vec<usize>, Cause> {
    if !fits(log.frames.len(), anchor) {
        let found = format!("{anchor} rows before and {} after it", log.frames.len() - anchor - 1);
        let expected = "at least 20 rows before and 160 after; choose another token";
        return Err(Cause::value("`lidar_pc` around the current frame", found, expected));
    }
    let rows: Vec<usize> =
        (0..FRAMES).map(|k| anchor + ROWS_PER_FRAME * k - ROWS_PER_FRAME * CURRENT).collect();
    let time = |row: usize| log.frames[row].timestamp;
    for pair in rows.windows(2) {
        let step = time(pair[1]).saturating_sub(time(pair[0]));
        if !FRAME_INTERVAL.contains(&step) {
            return Err(Cause::value(
                format!("`lidar_pc.timestamp` of row {}", log.frames[pair[1]].token),
                format!("{} s after the previous frame", step as f64 * 1e-6),
                "0.1 s; rows are missing here, choose a window before or after the gap",
            ));
        }
    }
    Ok(rows)
}
