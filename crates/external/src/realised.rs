//! The content of `plan`: the states realised since the last one.

use std::ops::Range;

use reactsim_rollout::Observation;

use super::document::{FrameWriter, Values};
use super::scenes::{frame_numbers, light_code, state_numbers};

/// Writes the request of a plan of `steps` steps. `episodes` are the handles of the batch, `n` its largest
/// number of agents; `seen` has the observation of each episode, `None` for padding. `lights` are the numbers
/// of lights of the episodes. The frames `new` are sent, the last of which is the present one.
pub(super) fn request(
    episodes: &[u64],
    n: usize,
    lights: &[usize],
    new: Range<usize>,
    seen: &[Option<Observation<'_>>],
    steps: usize,
) -> FrameWriter {
    let (b, t) = (episodes.len(), new.len());
    let mut states = Vec::with_capacity(b * n * t * 5);
    let mut valid = Vec::with_capacity(b * n * t);
    for seen in seen {
        for slot in 0..n {
            let known = seen.filter(|seen| slot < seen.tracks().len());
            let track = known.map_or(&[][..], |seen| &seen.track(slot)[new.clone()]);
            for k in 0..t {
                let state = track.get(k).copied().flatten();
                states.extend(frame_numbers(state));
                valid.push(u8::from(state.is_some()));
            }
        }
    }
    let mut light_states = Vec::with_capacity(lights.iter().sum::<usize>() * t);
    for (seen, count) in seen.iter().zip(lights) {
        for light in 0..*count {
            let seen = seen.map_or(&[][..], |seen| &seen.light(light)[new.clone()]);
            light_states.extend((0..t).map(|k| light_code(seen.get(k).copied().flatten())));
        }
    }
    let av_next = seen.iter().map(|seen| seen.and_then(|s| s.av_next()).map_or([f64::NAN; 5], state_numbers));
    let mut document = FrameWriter::new("plan");
    document
        .text("frame", (new.end - 1).to_string())
        .text("steps", steps.to_string())
        .tensor("episode", Values::u64(&[b], episodes.iter().copied()))
        .tensor("active", Values::u8(&[b], seen.iter().map(|seen| u8::from(seen.is_some()))))
        .tensor("states", Values::f64(&[b, n, t, 5], states))
        .tensor("valid", Values::u8(&[b, n, t], valid))
        .tensor("light_state", Values::u8(&[lights.iter().sum(), t], light_states))
        .tensor("av_next", Values::f64(&[b, 5], av_next.flatten().collect::<Vec<_>>()));
    document
}
