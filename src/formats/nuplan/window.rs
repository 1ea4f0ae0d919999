//! Which rows of a log make the frames of a scenario.

use super::log::Log;
use crate::formats::error::Cause;
use crate::scene::{CURRENT, FRAMES, FUTURE};

/// Rows of the clock (20 Hz) from one frame (10 Hz) to the next.
const STRIDE: usize = 2;
/// How far two successive frames are apart where no row is missing between them, microseconds.
const STEP: std::ops::Range<i64> = 50_000..150_000;

/// Whether there are enough rows before and after a frame.
pub(super) fn fits(log: &Log, anchor: usize) -> bool {
    anchor >= STRIDE * CURRENT && log.frames.len() - anchor > STRIDE * FUTURE
}

/// The rows of the 91 frames around a current one, by count.
///
/// # Errors
/// [`Cause`] when there are not enough, or time jumps between them.
pub(super) fn rows(log: &Log, anchor: usize) -> Result<Vec<usize>, Cause> {
    if !fits(log, anchor) {
        let found = format!("{anchor} rows before and {} after it", log.frames.len() - anchor - 1);
        let expected = "at least 20 rows before and 160 after; choose another token";
        return Err(Cause::value("`lidar_pc` around the current frame", found, expected));
    }
    let rows: Vec<usize> = (0..FRAMES).map(|k| anchor + STRIDE * k - STRIDE * CURRENT).collect();
    let time = |row: usize| log.frames[row].timestamp;
    for pair in rows.windows(2) {
        let step = time(pair[1]).saturating_sub(time(pair[0]));
        if !STEP.contains(&step) {
            return Err(Cause::value(
                format!("`lidar_pc.timestamp` of row {}", log.frames[pair[1]].token),
                format!("{} s after the frame before", step as f64 * 1e-6),
                "0.1 s; rows are missing here, choose a window beside the gap",
            ));
        }
    }
    Ok(rows)
}
