//! The frames of a recording that are read.

use std::num::NonZeroUsize;

use reactsim_scene::Length;

use super::message::Scenario as Proto;
use crate::crop::keep;
use crate::error::Cause;
use crate::frames::{LengthChoice, seconds};
use crate::wire::Fields;

/// Tag of the scenario field with the times of the frames.
const TIMESTAMPS_TAG: u32 = 1;
/// Size of a time in bytes.
const TIME_SIZE: usize = 8;

/// Names of the current frame in errors: that which a message states, and that which is chosen.
const STATED: &str = "current_time_index";
const CHOSEN: &str = "the current frame";
/// Remedy for a stated current frame with too few frames around it.
const OTHER_FRAME: &str = "; choose another with `current-frame` or `window-step`";

/// Window of frames that is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Window {
    /// The frames around the current frame that the recording states.
    Stated,
    /// The frames around this one, counted from 0, which becomes the current frame.
    At(usize),
    /// The same; the recording gives other windows too, so that its id gets the frame: `ID@FRAME`.
    OneOfMany(usize),
}

impl Window {
    /// Returns the windows of a message with a current frame every `step` frames:
    /// [`LengthChoice::windows`]. Only the fields of the message are counted.
    pub(super) fn every(
        step: NonZeroUsize,
        length: LengthChoice,
        payload: &[u8],
    ) -> impl Iterator<Item = Self> + use<> {
        let (mut fields, mut frames) = (Fields::new(payload), 0_usize);
        while let Ok(Some((tag, content))) = fields.next_content() {
            if tag == TIMESTAMPS_TAG {
                // Packed times are one field; otherwise each is a field, whose content is not returned.
                frames += (content.len() / TIME_SIZE).max(1);
            }
        }
        length.windows(frames, step).map(Self::OneOfMany)
    }

    /// Reduces a message to the frames of the window: recordings for training may have 20 s. A recording that
    /// ends at the current frame stays without a future, if the choice allows that. With another current
    /// frame than the stated one, the marks of tracks are removed: data sets choose them by the motion after
    /// the stated one. Returns the length of the scenario, and by how many frames its current frame is after
    /// a stated one that has too few before it.
    pub(super) fn crop(self, proto: &mut Proto, length: LengthChoice) -> Result<(Length, usize), Cause> {
        match self {
            Self::Stated => crop_to_stated(proto, length),
            Self::At(frame) => Ok((crop(proto, CHOSEN, frame, length)?, 0)),
            Self::OneOfMany(frame) => {
                let length = crop(proto, CHOSEN, frame, length)?;
                proto.scenario_id = format!("{}@{frame}", proto.scenario_id);
                Ok((length, 0))
            }
        }
    }
}

/// Reduces a message to the frames around the current frame that it states, or around the first one with the
/// requested history; returns the same as [`Window::crop`].
pub(crate) fn crop_to_stated(proto: &mut Proto, length: LengthChoice) -> Result<(Length, usize), Cause> {
    let stated = proto.current_time_index;
    let index = usize::try_from(stated);
    let stated = index.map_err(|_| Cause::value(STATED, stated, "the index of a frame"))?;
    let current = length.current(stated, proto.timestamps_seconds.len());
    Ok((crop(proto, STATED, current, length)?, current - stated))
}

fn crop(proto: &mut Proto, field: &str, current: usize, choice: LengthChoice) -> Result<Length, Cause> {
    let (frames, history) = (proto.timestamps_seconds.len(), choice.history());
    let remedy = if field == STATED { OTHER_FRAME } else { "" };
    let Some(first) = current.checked_sub(history - 1) else {
        if field == STATED && frames < history + choice.least_future() {
            return Err(too_few(choice, frames));
        }
        let expected =
            format!("at least {}, so that there are as many frames before it{remedy}", history - 1);
        return Err(Cause::value(field, current, expected));
    };
    let length = Length { history, future: choice.future(frames.saturating_sub(current.saturating_add(1))) };
    let end = current.saturating_add(length.future + 1);
    let is_padded = choice.pads() && frames.checked_sub(1) == Some(current);
    if length.future == 0 || frames < end && !is_padded {
        if current == history - 1 {
            return Err(too_few(choice, frames));
        }
        let future = choice.least_future();
        let expected = format!("a frame with {future} after it, of {frames} in the record{remedy}");
        return Err(Cause::value(field, current, expected));
    }
    for (i, track) in proto.tracks.iter().enumerate() {
        if track.states.len() != frames {
            let expected = format!("{frames} entries, as in timestamps_seconds");
            return Err(Cause::value(format!("tracks[{i}].states"), entries(track.states.len()), expected));
        }
    }
    let lights = proto.dynamic_map_states.len();
    if lights != 0 && lights != frames {
        let expected = format!("{frames} entries, as in timestamps_seconds, or none");
        return Err(Cause::value("dynamic_map_states", entries(lights), expected));
    }
    keep(&mut proto.timestamps_seconds, first..end);
    keep(&mut proto.dynamic_map_states, first..end);
    proto.tracks.iter_mut().for_each(|track| keep(&mut track.states, first..end));
    if usize::try_from(proto.current_time_index) != Ok(current) {
        proto.tracks_to_predict.clear();
        proto.objects_of_interest.clear();
    }
    proto.current_time_index = length.current() as i32;
    Ok(length)
}

/// Returns the error for a recording that has too few frames for any current frame.
fn too_few(choice: LengthChoice, frames: usize) -> Cause {
    let history = choice.history();
    let all = history + choice.least_future();
    let without = if choice.pads() { format!(", or {history} without the future") } else { String::new() };
    let expected = format!("{all} entries ({} s at 10 Hz) or more{without}", seconds(all));
    Cause::value("timestamps_seconds", entries(frames), expected)
}

fn entries(count: usize) -> String {
    format!("{count} entries")
}
