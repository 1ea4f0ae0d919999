//! Scores of known motion, all steps in one pass.

use burn::tensor::Device;
use reactsim::scene::{Frame, LightState, Start};

use super::batch::{SceneRows, map_tensors, node_tensors};
use super::network::PastNodes;
use super::places::Places;
use super::policy::Policy;
use super::step::{Step, View};

/// Logits of an agent's next token at a step.
#[derive(Clone, Debug, PartialEq)]
pub struct Logits {
    /// Frame of the step.
    pub frame: usize,
    /// Slot of the agent.
    pub slot: usize,
    /// One logit per token of the agent's class.
    pub values: Vec<f32>,
}

/// Known motion: a rollout or a log.
#[derive(Clone, Copy, Debug)]
pub struct Known<'a> {
    /// Agents and map.
    pub start: &'a Start,
    /// Frames of each agent.
    pub tracks: &'a [Vec<Frame>],
    /// State of each light per frame.
    pub lights: &'a [Vec<Option<LightState>>],
    /// Whether agents see the AV one frame ahead.
    pub av_lookahead: bool,
}

impl Policy {
    /// Returns the logits of all agents that are present at these frames (ascending), ordered by frame
    /// and slot. Every step attends to those before it, as in a rollout that is computed step by step.
    pub fn logits(&self, known: &Known<'_>, frames: &[usize], device: &Device) -> Vec<Logits> {
        let config = &self.config;
        let places = Places::known(known.start, config);
        let (mut steps, mut earlier): (Vec<Step>, _) = (Vec::new(), Vec::new());
        for &now in frames {
            let lights: Vec<_> = known.lights.iter().map(|l| l.get(now).copied().flatten()).collect();
            let next = known.tracks.first().and_then(|av| av.get(now + 1).copied().flatten());
            let av_next = next.filter(|_| known.av_lookahead);
            let view =
                View { agents: &known.start.agents, tracks: known.tracks, now, av_next, lights: &lights };
            let step = Step::of(&view, &places, &earlier, config);
            earlier.extend_from_slice(&step.here);
            steps.push(step);
        }
        let map = self.network.encode_map(&map_tensors(&[&places], config, device));
        let nodes = node_tensors(&[(steps.as_slice(), SceneRows::default())], config, device);
        let encoded = self.network.encode(&nodes, map, &PastNodes::Here);
        let mut logits = self.network.all_logits(&nodes, &encoded).into_iter();
        let nodes = steps.iter().flat_map(|s| s.slots.iter().map(|&slot| (s.frame, slot)));
        nodes.zip(&mut logits).map(|((frame, slot), values)| Logits { frame, slot, values }).collect()
    }
}
