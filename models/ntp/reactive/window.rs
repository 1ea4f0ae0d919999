//! Memory of computed steps between plans.

use reactsim_nn::SharedRows;
use reactsim_nn::perception::{Body, SceneView};
use reactsim_rollout::Observation;
use reactsim_scene::Frame;

use super::super::tokens::TOKEN_FRAMES;
use super::choice::Surroundings;
use super::config::Config;
use super::step::{EarlierNode, StepGraph};

/// A computed step.
#[derive(Clone, Debug)]
pub(crate) struct StepMemory {
    /// Frame of the step.
    pub frame: usize,
    /// Nodes of the step.
    pub nodes: Vec<EarlierNode>,
    /// For each block, the nodes as later steps attend to them, in tensors that the episodes of a batch
    /// share.
    pub entering: SharedRows,
}

/// Returns the frames of the earlier steps that a step at `now` attends to, oldest first: every half
/// second, as far as they exist.
pub(crate) fn earlier_frames(now: usize, past: usize) -> Vec<usize> {
    let back = |k: usize| now.checked_sub(k * TOKEN_FRAMES);
    (1..=past).rev().filter_map(back).collect()
}

/// Returns the steps of an observed episode at these frames, oldest first, and the bodies at the last one. For
/// frames before the last realized one, the AV's next state is known if the protocol shows the AV one frame ahead
/// at all.
pub(crate) fn observed_steps(
    seen: &Observation<'_>,
    tracks: &[Vec<Frame>],
    frames: &[usize],
    around: &mut Surroundings<'_>,
    config: &Config,
) -> (Vec<StepGraph>, Vec<Body>) {
    let mut earlier = Vec::new();
    let mut steps = Vec::with_capacity(frames.len());
    let mut bodies = Vec::new();
    for &now in frames {
        let step;
        (step, bodies) = step_at(&[], seen, tracks, now, around, &earlier, config);
        earlier.extend_from_slice(&step.here);
        steps.push(step);
    }
    (steps, bodies)
}

/// Returns the step at one frame, and the bodies of its nodes. `standing` are agents that stand, by slot, and are
/// no nodes.
pub(crate) fn step_at(
    standing: &[(usize, Body)],
    seen: &Observation<'_>,
    tracks: &[Vec<Frame>],
    now: usize,
    around: &mut Surroundings<'_>,
    earlier: &[EarlierNode],
    config: &Config,
) -> (StepGraph, Vec<Body>) {
    let realized = seen.frame();
    // After the last realized frame the AV is only predicted, and lights keep their states.
    let av_next = match seen.av_next() {
        Some(next) if now == realized => Some(next),
        Some(_) if now < realized => tracks[0][now + 1],
        _ => None,
    };
    let lights: Vec<_> = (0..seen.start().lights.len()).map(|l| seen.light(l)[now.min(realized)]).collect();
    let view = SceneView {
        agents: &seen.start().agents,
        tracks,
        now,
        av_next,
        lights: &lights,
        start: Some(seen.start()),
    };
    StepGraph::around(standing, &view, around, earlier, config)
}
