//! Velocities of tracks.

use reactsim_geometry::Vec2;
use reactsim_scene::{DT, Frame};

/// Returns the velocity at a frame, m/s: the recorded one, else the difference from the frame before,
/// else 0.
pub fn velocity_at(track: &[Frame], frame: usize) -> Vec2 {
    let Some(state) = track.get(frame).copied().flatten() else { return Vec2::zeros() };
    let before = || frame.checked_sub(1).and_then(|f| track[f]);
    let difference = || before().map(|b| (state.position() - b.position()) / DT);
    state.velocity().or_else(difference).unwrap_or_default()
}
