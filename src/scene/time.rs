//! The time axis of every scenario: 91 frames at 10 Hz, of which frame 10 is now (ReactSim-Bench, "Scenario Data").

/// Seconds between two frames.
pub const DT: f64 = 0.1;
/// Index of the current frame.
pub const CURRENT: usize = 10;
/// Frames up to and including the current one.
pub const HISTORY: usize = CURRENT + 1;
/// Frames after the current one: the steps 1 to 80 of a rollout.
pub const FUTURE: usize = 80;
/// All frames of a scenario.
pub const FRAMES: usize = HISTORY + FUTURE;
