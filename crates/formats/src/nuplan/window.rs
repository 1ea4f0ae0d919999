//! Rows of a log that become the frames of a scenario.

use reactsim_scene::Length;

use super::log::Log;
use crate::error::Cause;
use crate::frames::LengthChoice;

/// Number of rows of the clock (20 Hz) per frame (10 Hz).
pub(super) const ROWS_PER_FRAME: usize = 2;
/// Valid time in microseconds between successive frames; a longer time means missing rows.
const FRAME_INTERVAL: std::ops::Range<i64> = 50_000..150_000;

/// Number of rows that have to come before and after a frame.
pub(super) fn needed(length: LengthChoice) -> [usize; 2] {
    [length.history() - 1, length.least_future()].map(|frames| ROWS_PER_FRAME * frames)
}

/// Returns whether there are enough of all rows before and after a frame.
pub(super) fn fits(rows: usize, anchor: usize, length: LengthChoice) -> bool {
    let [before, after] = needed(length);
    anchor >= before && rows - anchor > after
}

/// Returns the rows of the frames around row `anchor`, counted without regard to time stamps, and the length
/// of the scenario. If all that is recorded is wanted, it ends where time jumps.
///
/// # Errors
/// [`Cause`] if there are not enough rows, or if time jumps between them.
pub(super) fn rows(log: &Log, anchor: usize, choice: LengthChoice) -> Result<(Vec<usize>, Length), Cause> {
    let after = log.frames.len() - anchor - 1;
    if !fits(log.frames.len(), anchor, choice) {
        let found = format!("{anchor} rows before and {after} after it");
        let [before, after] = needed(choice);
        let expected = format!("at least {before} rows before and {after} after; choose another token");
        return Err(Cause::value("`lidar_pc` around the current frame", found, expected));
    }
    let mut length = Length { history: choice.history(), future: choice.future(after / ROWS_PER_FRAME) };
    let first = anchor - ROWS_PER_FRAME * length.current();
    let mut rows: Vec<usize> = (0..length.frames()).map(|k| first + ROWS_PER_FRAME * k).collect();
    let step = |pair: &[usize]| log.frames[pair[1]].timestamp.saturating_sub(log.frames[pair[0]].timestamp);
    if let Some(jump) = rows.windows(2).position(|pair| !FRAME_INTERVAL.contains(&step(pair))) {
        let recorded = (jump + 1).saturating_sub(length.history);
        // What follows a jump is another recording.
        if choice.future(recorded) != recorded || recorded == 0 {
            let pair = &rows[jump..=jump + 1];
            return Err(Cause::value(
                format!("`lidar_pc.timestamp` of row {}", log.frames[pair[1]].token),
                format!("{} s after the previous frame", step(pair) as f64 * 1e-6),
                "0.1 s; rows are missing here, choose a window before or after the gap",
            ));
        }
        length.future = recorded;
        rows.truncate(length.frames());
    }
    Ok((rows, length))
}
