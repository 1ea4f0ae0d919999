//! The 91 frames of a recording that are read.

use reactsim_scene::{CURRENT, FUTURE};

use super::message::Scenario as Proto;
use super::size::Fields;
use crate::error::Cause;

/// Tag of the scenario field with the times of the frames.
const TIMESTAMPS_TAG: u64 = 1;
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
    /// Returns the windows of a message with a current frame every `step` frames, beginning with frame 10.
    /// Only the fields of the message are counted. A message that is too short for a window has one, so that
    /// the reason is reported.
    pub(super) fn every(step: usize, payload: &[u8]) -> impl Iterator<Item = Self> + use<> {
        let times = Fields(payload).filter(|(tag, _)| *tag == TIMESTAMPS_TAG);
        // Packed times are one field; otherwise each is a field, whose content is not returned.
        let frames: usize = times.map(|(_, content)| (content.len() / TIME_SIZE).max(1)).sum();
        let windows = frames.saturating_sub(CURRENT + FUTURE + 1) / step;
        (0..=windows).map(move |i| Self::OneOfMany(CURRENT + i * step))
    }

    /// Reduces a message to the frames of the window: recordings for training may have 20 s. A recording that
    /// ends at the current frame stays without a future. With another current frame than the stated one, the
    /// marks of tracks are removed: data sets choose them by the motion after the stated one.
    pub(super) fn crop(self, proto: &mut Proto) -> Result<(), Cause> {
        match self {
            Self::Stated => crop_to_stated(proto),
            Self::At(frame) => crop(proto, "the current frame", frame),
            Self::OneOfMany(frame) => {
                crop(proto, "the current frame", frame)?;
                proto.scenario_id = format!("{}@{frame}", proto.scenario_id);
                Ok(())
            }
        }
    }
}

/// Reduces a message to the frames around the current frame that it states.
pub(crate) fn crop_to_stated(proto: &mut Proto) -> Result<(), Cause> {
    let (field, stated) = ("current_time_index", proto.current_time_index);
    let current = usize::try_from(stated).map_err(|_| Cause::value(field, stated, "the index of a frame"))?;
    crop(proto, field, current)
}

fn crop(proto: &mut Proto, field: &str, current: usize) -> Result<(), Cause> {
    let frames = proto.timestamps_seconds.len();
    let Some(first) = current.checked_sub(CURRENT) else {
        let expected = "at least 10, so that there are ten frames of history";
        return Err(Cause::value(field, current, expected));
    };
    let end = current.saturating_add(FUTURE + 1);
    if frames < end && frames.checked_sub(1) != Some(current) {
        return Err(if current == CURRENT {
            let expected = "91 entries (9.1 s at 10 Hz) or more, or 11 without the future";
            Cause::value("timestamps_seconds", entries(frames), expected)
        } else {
            let expected = format!("a frame with 80 after it, of {frames} in the record");
            Cause::value(field, current, expected)
        });
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
    reduce(&mut proto.timestamps_seconds, first, end);
    reduce(&mut proto.dynamic_map_states, first, end);
    proto.tracks.iter_mut().for_each(|track| reduce(&mut track.states, first, end));
    if usize::try_from(proto.current_time_index) != Ok(current) {
        proto.tracks_to_predict.clear();
        proto.objects_of_interest.clear();
    }
    proto.current_time_index = CURRENT as i32;
    Ok(())
}

/// Removes the elements outside of a range.
fn reduce<T>(frames: &mut Vec<T>, first: usize, end: usize) {
    frames.truncate(end);
    frames.drain(..first.min(frames.len()));
}

fn entries(count: usize) -> String {
    format!("{count} entries")
}
