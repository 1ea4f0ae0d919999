//! The time axis of every scenario: 91 frames at 10 Hz, of which frame 10 is now (ReactSim-Bench, "Scenario
//! Data").

/// Time between two frames, seconds.
pub const DT: f64 = 0.1;
/// Index of the current frame.
pub const CURRENT: usize = 10;
/// Number of frames up to and including the current one.
pub const HISTORY: usize = CURRENT + 1;
/// Number of frames after the current one: the steps 1 to 80 of a rollout.
pub const FUTURE: usize = 80;
/// Number of frames of a scenario.
pub const FRAMES: usize = HISTORY + FUTURE;
