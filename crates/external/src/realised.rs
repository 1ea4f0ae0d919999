//! The content of `plan`: the states realised since the last one.

use reactsim_rollout::Episode;

use super::document::{FrameWriter, Values};
use super::scenes::{frame_numbers, light_code, state_numbers};

/// Writes the request of a plan. `episodes` are the handles of the batch, `n` its largest number of agents;
/// `active` are the episodes to plan by their index in the batch; the others are padding. `lights` are the
/// numbers of lights of all episodes of the batch. Frames from `from` on are sent.
pub(super) fn request(
    episodes: &[u64],
    n: usize,
    lights: &[usize],
    from: usize,
    active: &[(usize, &Episode<'_>)],
) -> FrameWriter {
    let b = episodes.len();
    let frame = active.first().map_or(from, |(_, episode)| episode.seen.frame());
    let steps = active.first().map_or(0, |(_, episode)| episode.plan.steps());
    let new = from..frame + 1;
    let t = new.len();
    let mut by_index: Vec<Option<&Episode<'_>>> = vec![None; b];
    for (index, episode) in active {
        by_index[*index] = Some(episode);
    }
    let mut states = Vec::with_capacity(b * n * t * 5);
    let mut valid = Vec::with_capacity(b * n * t);
    for episode in &by_index {
        for slot in 0..n {
            let track =
                episode.filter(|e| slot < e.plan.agents()).map_or(&[][..], |e| &e.seen.track(slot)[from..]);
            for k in 0..t {
                let state = track.get(k).copied().flatten();
                states.extend(frame_numbers(state));
                valid.push(u8::from(state.is_some()));
            }
        }
    }
    let mut light_states = Vec::with_capacity(lights.iter().sum::<usize>() * t);
    for (episode, count) in by_index.iter().zip(lights) {
        for light in 0..*count {
            let seen = episode.map_or(&[][..], |e| &e.seen.light(light)[from..]);
            light_states.extend((0..t).map(|k| light_code(seen.get(k).copied().flatten())));
        }
    }
    let av_next =
        by_index.iter().map(|e| e.and_then(|e| e.seen.av_next()).map_or([f64::NAN; 5], state_numbers));
    let mut document = FrameWriter::new("plan");
    document
        .text("frame", frame.to_string())
        .text("steps", steps.to_string())
        .tensor("episode", Values::u64(&[b], episodes.iter().copied()))
        .tensor("active", Values::u8(&[b], by_index.iter().map(|e| u8::from(e.is_some()))))
        .tensor("states", Values::f64(&[b, n, t, 5], states))
        .tensor("valid", Values::u8(&[b, n, t], valid))
        .tensor("light_state", Values::u8(&[lights.iter().sum(), t], light_states))
        .tensor("av_next", Values::f64(&[b, 5], av_next.flatten().collect::<Vec<_>>()));
    document
}
