//! Candidates of a learned planner: samples of Diffusion-Planner.

use burn::tensor::Device;
use reactsim_diffusion::planner::PlannerPolicy;
use reactsim_rollout::{Observation, Stream};
use reactsim_scene::{AgentState, Scenario};

use super::rules::LaneRoutes;
use super::{CandidateSource, NoProposal, Proposal};

/// A source that samples plans of the AV from a network, one per stream, and proposes all of them. Plans that
/// give routes and speeds alone are driven along the lanes; without any lane they are followed as they are.
#[derive(Debug)]
pub struct PlannerSource {
    policy: PlannerPolicy,
    temperature: f64,
    device: Device,
}

impl PlannerSource {
    /// Creates a source of this network, whose weights are on this device. `temperature` is the standard
    /// deviation of the noise that sampling starts from.
    pub fn new(policy: PlannerPolicy, temperature: f64, device: Device) -> Self {
        Self { policy, temperature, device }
    }
}

impl CandidateSource for PlannerSource {
    fn id(&self) -> &'static str {
        "diffusion"
    }

    fn propose(&self, scenario: &Scenario, streams: &mut [Stream]) -> Vec<Result<Proposal, NoProposal>> {
        let start = &scenario.start;
        let seen = Observation::new(start, &start.history, &start.light_history, None);
        let plans = self.policy.plans(&seen, self.temperature, streams, &self.device);
        let routes = if self.policy.sight.lanes { LaneRoutes::of(scenario) } else { None };
        let propose = |plan: Vec<AgentState>| {
            if !plan.iter().all(AgentState::is_finite) {
                return Err(NoProposal("the plan is no number".to_owned()));
            }
            let maneuver = format!("sample at temperature {}", self.temperature);
            let driven = routes.as_ref().and_then(|routes| routes.drive(&plan));
            let mut future = driven.unwrap_or(plan);
            future.truncate(scenario.length().future);
            Ok(Proposal { intent: None, maneuver, future })
        };
        plans.into_iter().map(propose).collect()
    }
}
