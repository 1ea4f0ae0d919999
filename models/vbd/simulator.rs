//! Agents that execute joint plans.

use burn::tensor::Device;
use reactsim::dynamics::STANDSTILL_SPEED;
use reactsim::rollout::{PlanError, Planning, SingleEpisode, Stream};
use reactsim::scene::{AgentState, DT, Start};

use super::inputs::{Seen, Sight};
use super::policy::VbdPolicy;
use super::sampling::{VbdParameters, sample};
use crate::models::perception::{KnownMap, SceneView};

/// Distance in metres: a standing agent stays if its plan for the next second is shorter.
const SET_OFF_DISTANCE: f64 = 0.2;
/// Number of frames of that second.
const SOON: usize = 10;

/// Simulator that samples a joint plan of all agents from the network and executes its first steps.
#[derive(Debug)]
pub struct VbdSimulator {
    id: &'static str,
    policy: VbdPolicy,
    parameters: VbdParameters,
    device: Device,
}

/// Memory of an episode between plans: the known map.
#[derive(Debug)]
pub struct VbdMemory(KnownMap);

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
        VbdMemory(self.policy.sight.map(start))
    }

    fn plan_one(&self, memory: &mut VbdMemory, episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        let observed = episode.seen;
        let lights = observed.lights_now();
        let view = SceneView::of(&observed, &lights);
        let mut plans = Vec::new();
        if let Some(seen) = Seen::of(&view, &memory.0, &self.sight()) {
            let mut av = observed.track(0).to_vec();
            av.extend(observed.av_next().map(Some));
            // An AV that the simulator moves has no motion of its own that would go on.
            let inpainting = self.parameters.inpainting && !episode.moves_av;
            let parameters = VbdParameters { inpainting, ..self.parameters };
            let states = sample(&self.policy, &seen, &av, &parameters, episode.stream, &self.device);
            // The policy was checked when it was read.
            plans = seen.slots.into_iter().zip(states.unwrap_or_default()).collect();
        }
        let steps = episode.plan.steps();
        for slot in 0..episode.plan.agents() {
            let Some(now) = observed.state(slot) else { continue };
            let plan = plans.iter().find(|(planned, _)| *planned == slot).map(|(_, states)| &states[..]);
            let states = match plan.filter(|plan| plan.iter().all(is_finite)) {
                Some(plan) => execute(plan, now, steps),
                None => {
                    if plan.is_some() {
                        let what = "plans that are no numbers: went on as before";
                        *episode.outcomes.entry(what).or_default() += 1;
                    }
                    go_on(now, steps)
                }
            };
            for (k, state) in states.into_iter().enumerate() {
                episode.plan.set(slot, k, Some(state));
            }
        }
        Ok(())
    }
}

fn is_finite(state: &AgentState) -> bool {
    [state.x, state.y, state.heading, state.vx, state.vy].iter().all(|v| v.is_finite())
}

/// Returns the states of the next steps by a plan; agents that stand and hardly move within a second stay.
fn execute(plan: &[AgentState], now: AgentState, steps: usize) -> Vec<AgentState> {
    let stands = now.velocity().is_none_or(|v| v.norm() < STANDSTILL_SPEED);
    let soon = plan.get(SOON - 1).or(plan.last());
    if stands && soon.is_none_or(|s| (s.position() - now.position()).norm() < SET_OFF_DISTANCE) {
        return vec![AgentState { vx: 0.0, vy: 0.0, ..now }; steps];
    }
    let mut states: Vec<AgentState> = plan.iter().take(steps).copied().collect();
    states.extend(go_on(plan.last().copied().unwrap_or(now), steps - states.len()));
    states
}

/// Returns the states of an agent beyond its plan, or one that the network does not see: it keeps its velocity.
fn go_on(now: AgentState, steps: usize) -> Vec<AgentState> {
    let v = now.velocity().unwrap_or_default();
    let after = |k: usize| {
        let p = now.position() + v * (k as f64 * DT);
        AgentState { x: p.x, y: p.y, heading: now.heading, vx: v.x, vy: v.y }
    };
    (1..=steps).map(after).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, vx: f64) -> AgentState {
        AgentState { x, y: 2.0, heading: 0.0, vx, vy: 0.0 }
    }

    #[test]
    fn agents_go_on_beyond_their_plans() {
        let states = execute(&[at(1.0, 10.0), at(2.0, 12.0)], at(0.0, 10.0), 4);
        let x: Vec<f64> = states.iter().map(|s| s.x).collect();
        assert!(x.iter().zip([1.0, 2.0, 3.2, 4.4]).all(|(x, wanted)| (x - wanted).abs() < 1e-12), "{x:?}");
        assert_eq!(execute(&[at(1.0, 10.0), at(2.0, 12.0)], at(0.0, 10.0), 1), [at(1.0, 10.0)]);
    }

    #[test]
    fn agents_that_stand_set_off_by_more_than_a_twitch() {
        let creeping: Vec<AgentState> = (1..=10).map(|k| at(0.01 * f64::from(k), 0.1)).collect();
        assert_eq!(execute(&creeping, at(0.0, 0.0), 5), [at(0.0, 0.0); 5]);
        let leaving: Vec<AgentState> = (1..=10).map(|k| at(0.03 * f64::from(k), 0.3)).collect();
        assert_eq!(execute(&leaving, at(0.0, 0.0), 5), leaving[..5]);
    }
}
