//! Scores of known motion, all steps in one pass.

use burn::tensor::{Device, Tensor};
use reactsim_nn::perception::{KnownMotion, denoised};

use super::batch::{SceneRows, map_tensors, node_tensors};
use super::cached_step::CachedStep;
use super::linked_places::LinkedPlaces;
use super::network::PastNodes;
use super::policy::Policy;
use super::step::StepGraph;

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

impl Policy {
    /// Returns the logits of all agents that are present at these frames (ascending), ordered by frame
    /// and slot. Every step attends to those before it, as in a rollout that is computed step by step.
    pub fn logits(&self, known: &KnownMotion<'_>, frames: &[usize], device: &Device) -> Vec<Logits> {
        let config = &self.config;
        let (steps, map) = self.steps(known, frames, device);
        let nodes = node_tensors(&[(steps.as_slice(), SceneRows::default())], config, device);
        let encoded = self.network.encode(&nodes, &map, &PastNodes::Here, None);
        let mut logits = self.network.all_logits(&nodes, &encoded.nodes).into_iter();
        let nodes = steps.iter().flat_map(|s| s.slots.iter().map(|&slot| (s.frame, slot)));
        nodes.zip(&mut logits).map(|((frame, slot), values)| Logits { frame, slot, values }).collect()
    }

    /// Returns the last of these steps (frames, ascending) with what it attends to; `None` without frames.
    pub fn cached_step(
        &self,
        known: &KnownMotion<'_>,
        frames: &[usize],
        device: &Device,
    ) -> Option<CachedStep<'_>> {
        let (mut steps, map) = self.steps(known, frames, device);
        let last = steps.pop()?;
        let nodes = node_tensors(&[(steps.as_slice(), SceneRows::default())], &self.config, device);
        let past = self.network.encode(&nodes, &map, &PastNodes::Here, None).entering;
        Some(CachedStep::new(&self.network, self.config, last, map, past, device))
    }

    /// Returns the steps at these frames, each of which attends to those before it, and the encoded places.
    fn steps(
        &self,
        known: &KnownMotion<'_>,
        frames: &[usize],
        device: &Device,
    ) -> (Vec<StepGraph>, Vec<Tensor<2>>) {
        let config = &self.config;
        let linked = LinkedPlaces::known(known.start, config);
        let tracks = denoised(known.tracks, known.start.current());
        let known = KnownMotion { tracks: &tracks, ..*known };
        let (mut steps, mut earlier): (Vec<StepGraph>, _) = (Vec::new(), Vec::new());
        for &now in frames {
            let lights = known.lights_at(now);
            let step = StepGraph::of(&known.view(now, &lights), &linked.places, &earlier, config);
            earlier.extend_from_slice(&step.here);
            steps.push(step);
        }
        (steps, self.network.encode_map(&map_tensors(&[&linked], config, device)))
    }
}
