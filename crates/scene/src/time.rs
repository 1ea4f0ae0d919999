//! The time axis of scenarios: frames at 10 Hz, of which those up to the current one are the history. The
//! benchmark has 91, of which frame 10 is now (ReactSim-Bench, "Scenario Data").

use std::fmt;

/// Time between two frames, seconds.
pub const DT: f64 = 0.1;
/// Index of the current frame in scenarios of the benchmark.
pub const CURRENT: usize = 10;
/// Number of frames up to and including the current one in the benchmark: what networks are trained with.
pub const HISTORY: usize = CURRENT + 1;
/// Number of frames after the current one in the benchmark: the steps 1 to 80 of a rollout.
pub const FUTURE: usize = 80;
/// Number of frames of a scenario of the benchmark.
pub const FRAMES: usize = HISTORY + FUTURE;

/// The length of a scenario, in frames at 10 Hz.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Length {
    /// Frames up to and including the current one.
    pub history: usize,
    /// Frames after the current one: the steps of a rollout.
    pub future: usize,
}

impl Length {
    /// The length of the benchmark: 11 and 80 frames.
    pub const BENCHMARK: Self = Self { history: HISTORY, future: FUTURE };
    /// Largest number of frames up to and including the current one; the smallest is 2.
    pub const MAX_HISTORY: usize = 100;
    /// Largest number of frames after the current one, 10 minutes; the smallest is 1.
    pub const MAX_FUTURE: usize = 6000;

    /// Returns the index of the current frame.
    pub const fn current(self) -> usize {
        self.history - 1
    }

    /// Returns the number of all frames.
    pub const fn frames(self) -> usize {
        self.history + self.future
    }

    /// Returns whether both numbers are within the limits.
    pub const fn is_valid(self) -> bool {
        self.history >= 2
            && self.history <= Self::MAX_HISTORY
            && self.future >= 1
            && self.future <= Self::MAX_FUTURE
    }
}

impl fmt::Display for Length {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} frames of history and {} steps", self.history, self.future)
    }
}

impl Default for Length {
    fn default() -> Self {
        Self::BENCHMARK
    }
}
