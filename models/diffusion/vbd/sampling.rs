//! Joint plans of all agents, sampled by denoising.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_rollout::Stream;
use reactsim_scene::AgentState;
use serde::{Deserialize, Serialize};

use super::inputs::Seen;
use super::policy::VbdPolicy;
use crate::{
    Sampler, Sampling, Schedule, ScheduleError, continued, motion_from, normalized, standard_normal,
    states_of,
};

/// Magnitude to which normalised actions are limited on the way (published).
const LIMIT: f64 = 5.0;

/// Parameters on the cards.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct VbdParameters {
    /// Number of agents that are planned, the AV first, then the nearest to it.
    pub agents: usize,
    /// Number of denoising steps.
    pub steps: usize,
    /// Whether steps draw new noise (DDPM); otherwise the first draw decides (DDIM).
    pub draws: bool,
    /// Standard deviation of the noise that plans start from; 1 as published.
    pub temperature: f64,
    /// Whether an action has the same noise in all plans of an episode; otherwise every plan draws anew, as
    /// published.
    pub keeps_noise: bool,
    /// Whether the AV's plan is fixed to the continuation of its executed motion while others are denoised.
    pub inpainting: bool,
}

/// Samples the states of the agents of a scene after each step of 0.1 s, `[agents, states]`, from this noise,
/// `[agents, actions, 2]`.
///
/// # Errors
/// [`ScheduleError`] if the network has no valid number of noise levels; reading the policy rules it out.
pub(super) fn sample(
    policy: &VbdPolicy,
    seen: &Seen,
    start: Vec<f32>,
    parameters: &VbdParameters,
    stream: &mut Stream,
    device: &Device,
) -> Result<Vec<Vec<AgentState>>, ScheduleError> {
    let config = &policy.config;
    let agents = seen.slots.len();
    let schedule = Schedule::cosine(config.noise_levels)?;
    let encoded = policy.network.encode(&seen.input, config, device);
    let speeds = seen.speeds(device);
    let shape = [agents, config.actions, 2];
    let start = Tensor::<3>::from_data(TensorData::new(start, shape), device) * parameters.temperature;
    // Without others there is nothing to denoise.
    let fixed = (parameters.inpainting && agents > 1).then(|| {
        let clean = given(&continued(seen.input.av_motion, config.actions, config.hold), device);
        let noise =
            (config.av_given == 0.0).then(|| standard_normal::<3>(stream, [1, config.actions, 2], device));
        (clean, noise)
    });
    let av_given = config.av_given > 0.0 && fixed.is_some();
    let scene = policy.network.prepare(&seen.input, &encoded, agents, av_given, config);
    let denoise = |noisy: Tensor<3>, level: usize| {
        let noisy = match &fixed {
            None => noisy,
            Some((clean, None)) => with_av(clean.clone(), noisy),
            Some((clean, Some(noise))) => {
                with_av(schedule.add_noise(clean.clone(), noise.clone(), level), noisy)
            }
        };
        policy.network.denoise(&scene, noisy, &speeds, level, config)
    };
    let sampler = if parameters.draws { Sampler::Ddpm } else { Sampler::Ddim };
    let sampling = Sampling { sampler, steps: parameters.steps, limit: LIMIT };
    let clean =
        sampling.sample(&schedule, start, denoise, || standard_normal(stream, shape, device), &mut ());
    Ok(states_of(&seen.states, motion_from(&seen.states, clean, config.hold, device)))
}

/// Returns the actions of all, `[agents, actions, 2]`, with these as those of the AV, `[1, actions, 2]`.
pub(super) fn with_av(av: Tensor<3>, all: Tensor<3>) -> Tensor<3> {
    let others = all.dims()[0] - 1;
    Tensor::cat(vec![av, all.narrow(0, 1, others)], 0)
}

/// Returns actions, m/s² and rad/s, normalised, `[1, actions, 2]`.
fn given(actions: &[[f64; 2]], device: &Device) -> Tensor<3> {
    let values: Vec<f32> = actions.iter().copied().flat_map(normalized).collect();
    let values = TensorData::new(values, [1, actions.len(), 2]);
    Tensor::<3>::from_data(values, device).clamp(-LIMIT, LIMIT)
}
