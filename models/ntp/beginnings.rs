//! Rollouts that begin alike.

use std::ptr;

use reactsim_rollout::Beginning;
use reactsim_scene::Start;

/// Returns the different starts of a batch of episodes, and which of them each episode has: rollouts of one
/// scenario share theirs, and what is made of it.
pub(crate) fn different_starts<'a>(batch: &[Beginning<'a>]) -> (Vec<&'a Start>, Vec<usize>) {
    let mut starts: Vec<&Start> = Vec::new();
    let of = |episode: &Beginning<'a>| {
        starts.iter().rposition(|start| ptr::eq(*start, episode.start)).unwrap_or_else(|| {
            starts.push(episode.start);
            starts.len() - 1
        })
    };
    let of = batch.iter().map(of).collect();
    (starts, of)
}
