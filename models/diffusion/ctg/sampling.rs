//! Plans of the agents of a scene.

use burn::tensor::Device;
use reactsim_nn::perception::Class;
use reactsim_rollout::Stream;
use reactsim_scene::{AgentState, DT};
use serde::{Deserialize, Serialize};

use super::guidance::{Other, RuleAgent, RuleGuide, RuleScene, Rules};
use super::inputs::Seen;
use super::policy::CtgPolicy;
use super::raster::Ground;
use crate::{Sampler, Sampling, Schedule, ScheduleError, motion_from, standard_normal, states_of};

/// Largest magnitude of normalised actions.
const LARGEST_ACTION: f64 = 5.0;

/// Parameters on the cards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CtgParameters {
    /// Number of agents that are planned, the nearest to the AV.
    pub agents: usize,
    /// Number of denoising steps.
    pub steps: usize,
    /// Number of joint plans that are sampled; the one with the smallest costs is executed.
    pub candidates: usize,
    /// Weights of the rules that guide and choose.
    pub rules: Rules,
}

impl CtgParameters {
    /// Returns the parameters of a network that does not denoise.
    pub fn cloning(agents: usize) -> Self {
        let rules = Rules { collision: 0.0, road: 0.0, speed: 0.0 };
        Self { agents, steps: 1, candidates: 1, rules }
    }
}

/// Returns the states of the agents of a scene after each step of 0.1 s, `[agents, states]`. Rules let them
/// keep clear of `others`.
///
/// # Errors
/// [`ScheduleError`] if the network has no valid number of noise levels; reading the policy rules it out.
pub(super) fn sample(
    policy: &CtgPolicy,
    seen: &Seen,
    ground: &Ground,
    others: Vec<Other>,
    parameters: &CtgParameters,
    stream: &mut Stream,
    device: &Device,
) -> Result<Vec<Vec<AgentState>>, ScheduleError> {
    let config = &policy.config;
    let (images, attributes, speeds) = Seen::tensors(&[seen], &policy.sight, device);
    let agents = policy.network.encode(images, attributes, speeds);
    let now = &seen.states;
    let states = |actions| states_of(now, motion_from(now, actions, config.hold, device));
    if let Some(actions) = policy.network.controls(&agents, config) {
        return Ok(states(actions.clamp(-LARGEST_ACTION, LARGEST_ACTION)));
    }
    let schedule = Schedule::cosine(config.noise_levels)?;
    let scene =
        RuleScene { rules: parameters.rules, agents: rule_agents(seen, ground), others, ground, dt: DT };
    let mut guide = RuleGuide { scene: &scene, now, hold: config.hold };
    let sampling = Sampling { sampler: Sampler::Ddpm, steps: parameters.steps, limit: LARGEST_ACTION };
    let shape = [seen.slots.len(), config.actions, 2];
    let mut plans = Vec::new();
    for _ in 0..parameters.candidates.max(1) {
        let start = standard_normal(stream, shape, device);
        let denoise = |noisy, level| policy.network.denoise(&agents, noisy, level, config);
        let noise = || standard_normal(stream, shape, device);
        let clean = sampling.sample(&schedule, start, denoise, noise, &mut guide);
        plans.push(clean.clamp(-LARGEST_ACTION, LARGEST_ACTION));
    }
    let chosen = match plans.len() {
        1 => 0,
        _ => cheapest(plans.iter().map(|plan| guide.costs(plan.clone()).iter().map(|cost| cost.value).sum())),
    };
    Ok(states(plans.swap_remove(chosen)))
}

/// Returns the number of the smallest of some costs, the first of equal ones; what is not a number counts as
/// the largest.
fn cheapest(costs: impl Iterator<Item = f64>) -> usize {
    let known = costs.map(|cost| if cost.is_nan() { f64::INFINITY } else { cost });
    known.enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b)).map_or(0, |(k, _)| k)
}

fn rule_agents(seen: &Seen, ground: &Ground) -> Vec<RuleAgent> {
    let agents = seen.states.iter().zip(&seen.sizes).zip(&seen.classes);
    let agent = |((state, size), class): ((&AgentState, &[f64; 2]), &Class)| RuleAgent {
        size: *size,
        is_vehicle: *class == Class::Vehicle,
        on_road: ground.away(state.position()).0 == 0.0,
    };
    agents.map(agent).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_of_the_cheapest_plans_is_chosen() {
        let choice = |costs: &[f64]| cheapest(costs.iter().copied());
        assert_eq!(choice(&[3.0, 1.0, 2.0, 1.0]), 1);
        assert_eq!(choice(&[0.0, 0.0]), 0);
        assert_eq!(choice(&[f64::NAN, 5.0, f64::NAN]), 1);
        assert_eq!(choice(&[f64::NAN, -f64::NAN]), 0);
    }
}
