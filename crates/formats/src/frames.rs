//! Choice of the frames of recordings that become scenarios.

use std::fmt;
use std::num::NonZeroUsize;
use std::str::FromStr;

use reactsim_scene::{DT, FUTURE, HISTORY, Length};
use serde::{Deserialize, Serialize};

use super::error::Cause;

/// Most states of all agents of a scenario that a reader makes of a short description, such as agents that
/// are seen once: those of a thousand agents over the longest time, with room to spare.
const MAX_STATES: usize = 20_000_000;
/// Most agents of a scenario, however short it is.
const MAX_AGENTS: usize = 10_000;

/// Frames of a recording that become the current frame of a scenario.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CurrentFrames {
    /// The frame that the recording states or the format defines.
    #[default]
    Stated,
    /// This frame, counted from 0.
    At(usize),
    /// The first frame with enough frames before it (frame 10 for 11 frames of history) and every so many
    /// frames after it, as far as enough frames follow: each gives a scenario, whose id is that of the
    /// recording, `@` and the frame.
    Every(NonZeroUsize),
}

/// Number of frames of scenarios.
///
/// Without a choice, files of this program's own formats have scenarios of their own length, and recordings
/// give the length of the benchmark: 11 frames up to the current one and 80 after it, of which some formats
/// fill up those that are not recorded.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct LengthChoice {
    /// Frames up to and including the current one.
    pub history: Option<usize>,
    /// Frames after the current one.
    pub future: Option<FutureChoice>,
}

/// Number of frames after the current one.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "RawFuture", into = "RawFuture")]
pub enum FutureChoice {
    /// This number.
    Steps(usize),
    /// All that are recorded, at most [`Length::MAX_FUTURE`].
    Log,
}

impl LengthChoice {
    /// Returns whether nothing is chosen.
    pub fn is_default(self) -> bool {
        self == Self::default()
    }

    /// Checks that the numbers are within the limits of scenarios.
    ///
    /// # Errors
    /// [`Cause`] names the number.
    pub fn check(self) -> Result<(), Cause> {
        let (history, future) = (self.history(), self.future(1));
        if !(2..=Length::MAX_HISTORY).contains(&history) {
            let expected = format!("2 to {} frames", Length::MAX_HISTORY);
            return Err(Cause::value("history", history, expected));
        }
        if !(1..=Length::MAX_FUTURE).contains(&future) {
            return Err(Cause::value("future", future, format!("1 to {} steps", Length::MAX_FUTURE)));
        }
        Ok(())
    }

    /// Returns the frames up to and including the current one of scenarios that are cut out of recordings.
    pub(crate) fn history(self) -> usize {
        self.history.unwrap_or(HISTORY)
    }

    /// Returns the frames after the current one of scenarios that are cut out of recordings, of which
    /// `recorded` follow: fewer or none if this is what is recorded, more if they are not.
    pub(crate) fn future(self, recorded: usize) -> usize {
        match self.future {
            None => FUTURE,
            Some(FutureChoice::Steps(steps)) => steps,
            Some(FutureChoice::Log) => recorded.min(Length::MAX_FUTURE),
        }
    }

    /// Returns the fewest frames that have to follow the current one.
    pub(crate) fn least_future(self) -> usize {
        self.future(1)
    }

    /// Returns the current frame of a recording of `recorded` frames whose default is frame `default`: that
    /// frame, or if fewer frames than requested come before it, the first one with as many, as far as enough
    /// follow.
    pub(crate) fn current(self, default: usize, recorded: usize) -> usize {
        match self.history.map(|history| history.saturating_sub(1)) {
            Some(first) if first > default && recorded > first + self.least_future() => first,
            _ => default,
        }
    }

    /// Returns the current frames of the windows of a recording of `recorded` frames, one every `step`
    /// frames: from the first one with enough frames before it on, as far as enough follow. A recording that
    /// is too short for a window has one, so that the reason is reported.
    pub(crate) fn windows(self, recorded: usize, step: NonZeroUsize) -> impl Iterator<Item = usize> {
        let first = self.history() - 1;
        let more = recorded.saturating_sub(first + self.least_future() + 1) / step;
        (0..=more).map(move |i| first + i * step.get())
    }

    /// Returns whether frames that are not recorded are filled up: those of the benchmark.
    pub(crate) fn pads(self) -> bool {
        self.future(0) == FUTURE
    }
}

impl FutureChoice {
    /// Returns the frames after the current one of a scenario that has `own` of them.
    pub(crate) fn of(self, own: usize) -> usize {
        match self {
            Self::Steps(steps) => steps,
            Self::Log => own,
        }
    }
}

/// Why a text is no [`FutureChoice`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "`{0}` is no future: expected steps of 0.1 s (`150`), seconds (`15s`), at most 600 s, or `log` for all \
     that is recorded"
)]
pub struct ParseFutureError(String);

impl FromStr for FutureChoice {
    type Err = ParseFutureError;

    fn from_str(text: &str) -> Result<Self, ParseFutureError> {
        let steps = match text.strip_suffix('s') {
            _ if text == "log" => return Ok(Self::Log),
            None => text.parse().ok(),
            Some(seconds) => seconds.parse::<f64>().ok().and_then(steps),
        };
        let valid = steps.filter(|steps| (1..=Length::MAX_FUTURE).contains(steps));
        valid.map(Self::Steps).ok_or_else(|| ParseFutureError(text.to_owned()))
    }
}

impl fmt::Display for FutureChoice {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Steps(steps) => write!(f, "{steps}"),
            Self::Log => f.write_str("log"),
        }
    }
}

/// A [`FutureChoice`] in files: a number of steps, or a text.
#[derive(Serialize, Deserialize)]
#[serde(untagged)]
enum RawFuture {
    Steps(usize),
    Text(String),
}

impl TryFrom<RawFuture> for FutureChoice {
    type Error = ParseFutureError;

    fn try_from(raw: RawFuture) -> Result<Self, ParseFutureError> {
        match raw {
            RawFuture::Steps(steps) => steps.to_string().parse(),
            RawFuture::Text(text) => text.parse(),
        }
    }
}

impl From<FutureChoice> for RawFuture {
    fn from(choice: FutureChoice) -> Self {
        match choice {
            FutureChoice::Steps(steps) => Self::Steps(steps),
            FutureChoice::Log => Self::Text("log".to_owned()),
        }
    }
}

/// Returns the number of steps in a time in seconds, if it is a whole one.
fn steps(seconds: f64) -> Option<usize> {
    let steps = seconds / DT;
    let is_whole = steps <= Length::MAX_FUTURE as f64 + 0.5 && (steps - steps.round()).abs() < 1e-6;
    (steps >= 0.5 && is_whole).then_some(steps.round() as usize)
}

/// Returns how many agents a scenario of so many frames may have.
pub(crate) fn most_agents(frames: usize) -> usize {
    MAX_AGENTS.min(MAX_STATES / frames.max(1))
}

/// Refuses more lights than a scenario of so many frames may have, however seldom they are observed.
pub(crate) fn check_lights(lights: usize, frames: usize) -> Result<(), Cause> {
    let most = MAX_STATES / frames.max(1);
    if lights <= most {
        return Ok(());
    }
    let expected = format!("at most {most} in {frames} frames");
    Err(Cause::value("the number of lights", lights, expected))
}

/// Returns the time of a number of frames in seconds, for messages.
pub(crate) fn seconds(frames: usize) -> f64 {
    frames as f64 / 10.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn futures_are_steps_seconds_or_all() {
        let parsed = |text: &str| text.parse::<FutureChoice>();
        assert_eq!(parsed("150"), Ok(FutureChoice::Steps(150)));
        assert_eq!(parsed("15s"), Ok(FutureChoice::Steps(150)));
        assert_eq!(parsed("0.3s"), Ok(FutureChoice::Steps(3)));
        assert_eq!(parsed("600s"), Ok(FutureChoice::Steps(6000)));
        assert_eq!(parsed("log"), Ok(FutureChoice::Log));
        for text in ["0", "0s", "-1", "6001", "600.1s", "0.25s", "NaNs", "infs", "s", "", "15 s", "Log"] {
            assert_eq!(parsed(text), Err(ParseFutureError(text.to_owned())));
        }
        let read = |text: &str| serde_json::from_str::<FutureChoice>(text);
        assert_eq!(read("\"15s\"").unwrap(), FutureChoice::Steps(150));
        assert_eq!(read("150").unwrap(), FutureChoice::Steps(150));
        assert!(read("0").unwrap_err().to_string().contains("`0` is no future"));
        for choice in [FutureChoice::Steps(42), FutureChoice::Log] {
            assert_eq!(read(&serde_json::to_string(&choice).unwrap()).unwrap(), choice);
            assert_eq!(parsed(&choice.to_string()), Ok(choice));
        }
    }

    #[test]
    fn only_the_length_of_the_benchmark_is_filled_up() {
        let of = |future| LengthChoice { history: Some(5), future };
        assert!(of(None).pads() && of(Some(FutureChoice::Steps(80))).pads());
        assert!(!of(Some(FutureChoice::Steps(60))).pads() && !of(Some(FutureChoice::Log)).pads());
        assert_eq!([of(None).future(7), of(Some(FutureChoice::Log)).future(7)], [80, 7]);
        assert_eq!((most_agents(91), most_agents(6100)), (10_000, 3278));
    }
}
