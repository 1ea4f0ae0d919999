//! The frames of a recording that are read.

use reactsim_scene::Length;

/// Window of frames of a recording that are read.
#[derive(Clone, Copy)]
pub(super) struct Window {
    /// Index of the first frame in the recording.
    pub(super) first: usize,
    /// Number of frames of the recording.
    pub(super) length: usize,
    /// Length of the scenario, some frames of which may be missing at the end.
    pub(super) scenario: Length,
}

impl Window {
    /// Returns the frames of the recording in the window.
    pub(super) fn recorded(self) -> std::ops::Range<usize> {
        self.first..self.length.min(self.first + self.scenario.frames())
    }
}
