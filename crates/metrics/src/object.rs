//! The agents of a case.

use std::borrow::Cow;

use reactsim_scene::{Agent, Frame};

/// One agent with its evaluated track.
#[derive(Clone, Debug)]
pub struct Object<'a> {
    /// The agent.
    pub agent: &'a Agent,
    /// All frames: history, then the evaluated future. Frames beyond its end are absent.
    pub track: Cow<'a, [Frame]>,
}

/// The log of one agent, split at the current frame.
#[derive(Clone, Copy, Debug)]
pub struct LoggedTrack<'a> {
    /// Frames up to and including the current one.
    pub history: &'a [Frame],
    /// Frames after the current one.
    pub future: &'a [Frame],
    /// Recorded x, y and heading of the history, including invalid frames. The finite differences of the
    /// kinematic likelihood ignore validity. `None`: the valid frames of `history`.
    pub recorded_history: Option<&'a [[f64; 3]]>,
}

impl LoggedTrack<'_> {
    /// Returns the frames from `frame` on.
    pub(super) fn from(&self, frame: usize) -> Vec<Frame> {
        self.history.iter().chain(self.future).skip(frame).copied().collect()
    }

    /// Returns the logged state at a frame.
    pub fn at(&self, frame: usize) -> Frame {
        match frame.checked_sub(self.history.len()) {
            None => self.history[frame],
            Some(k) => self.future.get(k).copied().flatten(),
        }
    }
}
