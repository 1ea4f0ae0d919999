//! Agents that execute their plans.

use burn::tensor::Device;
use reactsim_nn::perception::SceneView;
use reactsim_rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim_scene::{FUTURE, Start};

use super::guidance::others;
use super::inputs::Seen;
use super::policy::CtgPolicy;
use super::raster::{Ground, GroundShapes};
use super::sampling::{CtgParameters, sample};
use crate::joint_plan;

/// Distance in metres by which more of the map is known than in training: the AV moves away from its middle.
const WAY_OF_AV: f64 = 100.0;

/// Simulator that finds a plan of each agent by the network and executes its first steps.
#[derive(Debug)]
pub struct CtgSimulator {
    id: &'static str,
    policy: CtgPolicy,
    parameters: CtgParameters,
    device: Device,
}

/// Memory of an episode between plans: the ground.
#[derive(Debug)]
pub struct CtgMemory(Ground);

impl CtgSimulator {
    /// Builds a simulator of this policy, whose weights are on this device, under the id of its baseline.
    pub fn new(id: &'static str, policy: CtgPolicy, parameters: CtgParameters, device: Device) -> Self {
        Self { id, policy, parameters, device }
    }
}

impl SingleEpisode for CtgSimulator {
    type Memory = CtgMemory;

    fn id(&self) -> &'static str {
        self.id
    }

    fn begin(&self, start: &Start, _stream: &mut Stream) -> CtgMemory {
        let ground = Ground::of(&GroundShapes::of(start), self.policy.sight.radius + WAY_OF_AV);
        CtgMemory(if self.parameters.rules.road > 0.0 { ground.with_distances() } else { ground })
    }

    fn horizon(&self) -> Option<usize> {
        Some(FUTURE)
    }

    fn plan_one(&self, memory: &mut CtgMemory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let observed = episode.seen;
        let lights = observed.lights_now();
        let view = SceneView::of(&observed, &lights);
        // An external AV is no agent of the simulator; its place among the nearest is left to the next one.
        let external = usize::from(!episode.moves_av);
        let slots = view.nearest_agents(self.parameters.agents + external);
        let planned = slots.into_iter().filter(|slot| *slot >= external);
        let seen = Seen::of(&view, planned, &memory.0, &self.policy.sight);
        let mut plans = Vec::new();
        if !seen.slots.is_empty() {
            let others = match self.parameters.rules.any() {
                true => others(&view, &seen.slots, self.policy.config.states()),
                false => Vec::new(),
            };
            let (ground, stream) = (&memory.0, &mut *episode.stream);
            let states = sample(&self.policy, &seen, ground, others, &self.parameters, stream, &self.device);
            // The policy was checked when it was read.
            plans = seen.slots.into_iter().zip(states.unwrap_or_default()).collect();
        }
        joint_plan::execute(&plans, episode);
        Ok(())
    }
}
