//! What the network remembers of an episode between two plans.

use burn::tensor::Tensor;
use reactsim::rollout::Observation;
use reactsim::scene::Frame;

use super::super::tokens::TOKEN_FRAMES;
use super::config::Config;
use super::places::Places;
use super::step::{Earlier, Step, View};

/// One step that was computed: its nodes, and per block the states with which they entered it.
#[derive(Clone, Debug)]
pub(crate) struct Remembered {
    /// Frame of the step.
    pub frame: usize,
    /// The nodes.
    pub nodes: Vec<Earlier>,
    /// Per block `[n, hidden]`.
    pub entering: Vec<Tensor<2>>,
}

/// The frames of the earlier steps that a step at `now` attends to, oldest first: every half second, as far as there are any.
pub(crate) fn earlier_frames(now: usize, past: usize) -> Vec<usize> {
    let back = |k: usize| now.checked_sub(k * TOKEN_FRAMES);
    (1..=past).rev().filter_map(back).collect()
}

/// Steps of an observed episode at the given frames and at the last one of the tracks, oldest first. What the AV did a frame later is
/// known for frames before the last one if the protocol shows the AV one step ahead at all.
pub(crate) fn observed_steps(
    seen: &Observation<'_>,
    tracks: &[Vec<Frame>],
    frames: &[usize],
    places: &Places,
    config: &Config,
) -> Vec<Step> {
    let mut earlier = Vec::new();
    let mut steps = Vec::with_capacity(frames.len());
    for &now in frames {
        let step = step_at(seen, tracks, now, places, &earlier, config);
        earlier.extend_from_slice(&step.here);
        steps.push(step);
    }
    steps
}

/// The step at one frame.
pub(crate) fn step_at(
    seen: &Observation<'_>,
    tracks: &[Vec<Frame>],
    now: usize,
    places: &Places,
    earlier: &[Earlier],
    config: &Config,
) -> Step {
    let real = seen.frame();
    // After the last realised frame the AV is only guessed, and lights stay as they are.
    let av_next = match seen.av_next() {
        Some(next) if now == real => Some(next),
        Some(_) if now < real => tracks[0][now + 1],
        _ => None,
    };
    let lights: Vec<_> = (0..seen.start().lights.len()).map(|l| seen.light(l)[now.min(real)]).collect();
    let view = View { agents: &seen.start().agents, tracks, now, av_next, lights: &lights };
    Step::of(&view, places, earlier, config)
}
