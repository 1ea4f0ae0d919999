//! The frames of a recording that are read.

use reactsim_scene::FRAMES;

/// Window of frames of a recording that are read.
#[derive(Clone, Copy)]
pub(super) struct Window {
    /// Index of the first of the 91 frames in the recording.
    pub(super) first: usize,
    /// Number of frames of the recording.
    pub(super) length: usize,
}

impl Window {
    /// Returns the frames of the recording in the window.
    pub(super) fn recorded(self) -> std::ops::Range<usize> {
        self.first..self.length.min(self.first + FRAMES)
    }
}
