//! Motion that goes on as it was.

use reactsim_scene::{DT, Frame};

use super::inverse::actions;

/// Time in seconds for which acceleration and yaw rate are kept; then both are 0.
const KEPT_DURATION: f64 = 3.0;
/// Number of frames over which these are measured.
pub(crate) const MEASURED_FRAMES: usize = 5;

/// Returns acceleration (m/s²) and yaw rate (rad/s) over the last half second of a track; 0 where unknown.
pub fn latest_motion(track: &[Frame]) -> [f64; 2] {
    let last = &track[track.len().saturating_sub(MEASURED_FRAMES + 1)..];
    let measured = actions(last, last.len().saturating_sub(1).max(1));
    measured.values.first().copied().unwrap_or_default()
}

/// Returns the accelerations (m/s²) and yaw rates (rad/s) by which an agent goes on with its
/// [`latest_motion`], each held for `hold` steps of 0.1 s.
pub fn continued(latest: [f64; 2], count: usize, hold: usize) -> Vec<[f64; 2]> {
    let action = |k: usize| if (k * hold) as f64 * DT < KEPT_DURATION { latest } else { [0.0; 2] };
    (0..count).map(action).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_scene::AgentState;

    use super::*;

    #[test]
    fn the_latest_motion_is_kept_for_three_seconds() {
        // A second of constant speed, then half a second of braking in a bend.
        let state = |k: u8| {
            let since = f64::from(k.saturating_sub(10)) * DT;
            let heading = 0.2 * since;
            Some(AgentState { x: 0.0, y: 0.0, heading, vx: 8.0 - 2.0 * since, vy: 0.0 })
        };
        let track: Vec<Frame> = (0..=15).map(state).collect();
        let found = continued(latest_motion(&track), 8, 5);
        for (k, [acceleration, yaw_rate]) in found.into_iter().enumerate() {
            let wanted = if k < 6 { [-2.0, 0.2] } else { [0.0, 0.0] };
            assert!((acceleration - wanted[0]).abs() < 1e-9 && (yaw_rate - wanted[1]).abs() < 1e-9, "{k}");
        }
        assert_eq!(latest_motion(&[]), [0.0; 2]);
    }
}
