//! Agents that execute joint plans.

use burn::tensor::Device;
use reactsim_nn::perception::{KnownMap, SceneView};
use reactsim_rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::{FUTURE, Start};

use super::inputs::{Seen, Sight};
use super::network::VbdConfig;
use super::noise::Noise;
use super::policy::VbdPolicy;
use super::sampling::{VbdParameters, sample};
use crate::joint_plan;

/// Simulator that samples a joint plan of all agents from the network and executes its first steps.
#[derive(Debug)]
pub struct VbdSimulator {
    id: &'static str,
    policy: VbdPolicy,
    parameters: VbdParameters,
    device: Device,
}

/// Memory of an episode between plans.
#[derive(Debug)]
pub struct VbdMemory {
    map: KnownMap,
    noise: Noise,
}

impl VbdSimulator {
    /// Builds a simulator of this policy, whose weights are on this device, under the id of its baseline.
    pub fn new(id: &'static str, policy: VbdPolicy, parameters: VbdParameters, device: Device) -> Self {
        Self { id, policy, parameters, device }
    }

    /// Returns the limits of the input. The network computes any number of agents, whatever it was trained with.
    fn sight(&self) -> Sight {
        Sight { agents: self.parameters.agents, ..self.policy.sight }
    }
}

impl SingleEpisode for VbdSimulator {
    type Memory = VbdMemory;

    fn id(&self) -> &'static str {
        self.id
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> VbdMemory {
        VbdMemory { map: self.policy.sight.map(start), noise: Noise::default() }
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    fn plan_one(&self, memory: &mut VbdMemory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let observed = episode.seen;
        let lights = observed.lights_now();
        let view = SceneView::of(&observed, &lights);
        let mut plans = Vec::new();
        if let Some(seen) = Seen::of(&view, &memory.map, &self.sight()) {
            // An AV that the simulator moves has no motion of its own that would go on.
            let inpainting = self.parameters.inpainting && !episode.moves_av;
            let parameters = VbdParameters { inpainting, ..self.parameters };
            let VbdConfig { actions, hold, .. } = self.policy.config;
            let mut fresh = Noise::default();
            let (noise, first) = match parameters.keeps_noise {
                true => (&mut memory.noise, observed.step() / hold),
                false => (&mut fresh, 0),
            };
            let noise = noise.of(&seen.slots, first, actions, episode.stream);
            let states = sample(&self.policy, &seen, noise, &parameters, episode.stream, &self.device);
            // The policy was checked when it was read.
            plans = seen.slots.into_iter().zip(states.unwrap_or_default()).collect();
        }
        joint_plan::execute(&plans, episode);
        Ok(())
    }
}
