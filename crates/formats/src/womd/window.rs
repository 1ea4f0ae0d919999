//! The frames of a recording that are read.

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
    /// Returns the windows of a message with a current frame every `step` frames, beginning with the first
    /// one that has enough history (frame 10 by default). Only the fields of the message are counted. A
    /// message that is too short for a window has one, so that the reason is reported.
    pub(super) fn every(
        step: usize,
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
        let first = length.history() - 1;
        let windows = frames.saturating_sub(first + length.least_future() + 1) / step;
        (0..=windows).map(move |i| Self::OneOfMany(first + i * step))
    }

    /// Reduces a message to the frames of the window: recordings for training may have 20 s. A recording that
    /// ends at the current frame stays without a future, if the choice allows that. With another current
    /// frame than the stated one, the marks of tracks are removed: data sets choose them by the motion after
    /// the stated one. Returns the length of the scenario.
    pub(super) fn crop(self, proto: &mut Proto, length: LengthChoice) -> Result<Length, Cause> {
        match self {
            Self::Stated => crop_to_stated(proto, length),
            Self::At(frame) => crop(proto, "the current frame", frame, length),
            Self::OneOfMany(frame) => {
                let length = crop(proto, "the current frame", frame, length)?;
                proto.scenario_id = format!("{}@{frame}", proto.scenario_id);
                Ok(length)
            }
        }
    }
}

/// Reduces a message to the frames around the current frame that it states, and returns the length of the
/// scenario.
pub(crate) fn crop_to_stated(proto: &mut Proto, length: LengthChoice) -> Result<Length, Cause> {
    let (field, stated) = ("current_time_index", proto.current_time_index);
    let current = usize::try_from(stated).map_err(|_| Cause::value(field, stated, "the index of a frame"))?;
    crop(proto, field, current, length)
}

fn crop(proto: &mut Proto, field: &str, current: usize, choice: LengthChoice) -> Result<Length, Cause> {
    let (frames, history) = (proto.timestamps_seconds.len(), choice.history());
    let Some(first) = current.checked_sub(history - 1) else {
        let expected = format!("at least {}, so that there are as many frames before it", history - 1);
        return Err(Cause::value(field, current, expected));
    };
    let length = Length { history, future: choice.future(frames.saturating_sub(current.saturating_add(1))) };
    let end = current.saturating_add(length.future + 1);
    let is_padded = choice.pads() && frames.checked_sub(1) == Some(current);
    if length.future == 0 || frames < end && !is_padded {
        return Err(too_short(field, current, choice, frames));
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

/// Returns the error for a recording that does not have the frames after the current one.
fn too_short(field: &str, current: usize, choice: LengthChoice, frames: usize) -> Cause {
    let Length { history, future } = Length { history: choice.history(), future: choice.least_future() };
    let all = history + future;
    if current != history - 1 {
        return Cause::value(
            field,
            current,
            format!("a frame with {future} after it, of {frames} in the record"),
        );
    }
    let without = if choice.pads() { format!(", or {history} without the future") } else { String::new() };
    let expected = format!("{all} entries ({} s at 10 Hz) or more{without}", seconds(all));
    Cause::value("timestamps_seconds", entries(frames), expected)
}

fn entries(count: usize) -> String {
    format!("{count} entries")
}
