//! Magnitudes from which values of files are taken for damage.

use reactsim_geometry::Vec2;

use super::{AgentState, Frame};

/// Coordinate magnitude relative to the AV, in metres.
pub const MAX_COORDINATE: f64 = 100_000.0;
/// Box length or width in metres.
pub const MAX_BOX_SIZE: f64 = 1000.0;
/// Velocity component in m/s.
pub const MAX_VELOCITY: f64 = 1000.0;
/// Heading magnitude in radians: about a thousand turns.
pub const MAX_HEADING: f64 = 6300.0;

/// Returns the name and the value of a state that is beyond the limits, and what is expected instead.
/// `center` is a position of the AV. Unknown velocities (NaN) are accepted.
pub fn beyond(state: &AgentState, center: Vec2) -> Option<(&'static str, f64, &'static str)> {
    let far = "a position within 100 km of the AV";
    let fast = "a velocity below 1000 m/s";
    [
        ("x", state.x, (state.x - center.x).abs() < MAX_COORDINATE, far),
        ("y", state.y, (state.y - center.y).abs() < MAX_COORDINATE, far),
        ("heading", state.heading, state.heading.abs() < MAX_HEADING, "a heading below a thousand turns"),
        ("vx", state.vx, state.vx.is_nan() || state.vx.abs() < MAX_VELOCITY, fast),
        ("vy", state.vy, state.vy.is_nan() || state.vy.abs() < MAX_VELOCITY, fast),
    ]
    .into_iter()
    .find(|(_, _, is_within, _)| !is_within)
    .map(|(name, value, _, expected)| (name, value, expected))
}

/// Returns the index of the first state of a track that is beyond the limits, with the result of [`beyond`].
pub fn first_beyond(track: &[Frame], center: Vec2) -> Option<(usize, &'static str, f64, &'static str)> {
    track.iter().enumerate().find_map(|(i, state)| {
        let (name, value, expected) = beyond(state.as_ref()?, center)?;
        Some((i, name, value, expected))
    })
}

/// Removes the states of a track that are beyond the limits: files fill the slots of agents without an extent
/// with zeros, which are far from positions in the world.
pub fn drop_beyond(track: &mut [Frame], center: Vec2) {
    for frame in track {
        if frame.is_some_and(|state| beyond(&state, center).is_some()) {
            *frame = None;
        }
    }
}
