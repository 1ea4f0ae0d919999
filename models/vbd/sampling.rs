//! Joint plans of all agents, sampled by denoising.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim::rollout::Stream;
use reactsim::scene::{AgentState, DT, Frame};
use serde::{Deserialize, Serialize};

use super::inputs::Seen;
use super::network::{DEVIATIONS, unnormalized};
use super::policy::VbdPolicy;
use crate::models::diffusion::{
    Sampler, Sampling, Schedule, ScheduleError, actions, roll_out, standard_normal,
};

/// Magnitude to which normalised actions are limited on the way (published).
const LIMIT: f64 = 5.0;
/// Time for which the AV is thought to keep its acceleration and yaw rate, seconds; then both are 0.
const KEPT: f64 = 3.0;
/// Number of frames over which these are measured.
const MEASURED: usize = 5;

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
    /// Whether the AV's plan is fixed to the continuation of its executed motion while others are denoised.
    pub inpainting: bool,
}

/// Samples the states of the agents of a scene after each step of 0.1 s, `[agents, states]`.
///
/// `av` is the executed motion of the AV up to now, and one frame more if agents see it.
///
/// # Errors
/// [`ScheduleError`] if the network has no valid number of noise levels; reading the policy rules it out.
pub(super) fn sample(
    policy: &VbdPolicy,
    seen: &Seen,
    av: &[Frame],
    parameters: &VbdParameters,
    stream: &mut Stream,
    device: &Device,
) -> Result<Vec<Vec<AgentState>>, ScheduleError> {
    let config = &policy.config;
    let agents = seen.slots.len();
    let schedule = Schedule::cosine(config.noise_levels)?;
    let scene = policy.network.encode(&seen.input, config, device);
    let scene = policy.network.prepare(&scene, agents, config);
    let speeds = seen.speeds(device);
    let shape = [agents, config.actions, 2];
    let start: Tensor<3> = standard_normal(stream, shape, device);
    let fixed = parameters.inpainting.then(|| {
        let clean = continued(av, config.actions, config.hold, device);
        (clean, standard_normal::<3>(stream, [1, config.actions, 2], device))
    });
    let denoise = |noisy: Tensor<3>, level: usize| {
        let noisy = match &fixed {
            // Without others there is nothing to denoise.
            Some((clean, noise)) if agents > 1 => {
                let av = schedule.add_noise(clean.clone(), noise.clone(), level);
                Tensor::cat(vec![av, noisy.narrow(0, 1, agents - 1)], 0)
            }
            _ => noisy,
        };
        policy.network.denoise(&scene, noisy, &speeds, level, config)
    };
    let sampler = if parameters.draws { Sampler::Ddpm } else { Sampler::Ddim };
    let sampling = Sampling { sampler, steps: parameters.steps, limit: LIMIT };
    let clean =
        sampling.sample(&schedule, start, denoise, || standard_normal(stream, shape, device), &mut ());
    // From the origin, where single precision is finest.
    let from_origin = |s: &AgentState| [0.0, 0.0, s.heading as f32, s.vx as f32, s.vy as f32];
    let starts: Vec<f32> = seen.states.iter().flat_map(from_origin).collect();
    let starts = Tensor::<2>::from_data(TensorData::new(starts, [agents, 5]), device);
    let states = roll_out(&starts, unnormalized(clean), config.hold, None);
    let states: Vec<f32> = states.into_data().iter::<f32>().collect();
    let of_agent = |(own, now): (&[f32], &AgentState)| {
        let state = |s: &[f32]| {
            let [x, y, yaw, vx, vy] = [s[0], s[1], s[2], s[3], s[4]].map(f64::from);
            AgentState { x: now.x + x, y: now.y + y, heading: reactsim::geometry::wrap(yaw), vx, vy }
        };
        own.chunks(5).map(state).collect()
    };
    Ok(states.chunks(5 * config.states()).zip(&seen.states).map(of_agent).collect())
}

/// Returns the normalised actions by which the AV goes on as it does, `[1, actions, 2]`.
fn continued(av: &[Frame], count: usize, hold: usize, device: &Device) -> Tensor<3> {
    let last = &av[av.len().saturating_sub(MEASURED + 1)..];
    let measured = actions(last, last.len().saturating_sub(1).max(1));
    let [acceleration, yaw_rate] = measured.values.first().copied().unwrap_or_default();
    let mut values = Vec::with_capacity(2 * count);
    for k in 0..count {
        let keeps = f64::from(u8::from((k * hold) as f64 * DT < KEPT));
        values.push((keeps * acceleration) as f32 / DEVIATIONS[0]);
        values.push((keeps * yaw_rate) as f32 / DEVIATIONS[1]);
    }
    Tensor::<3>::from_data(TensorData::new(values, [1, count, 2]), device).clamp(-LIMIT, LIMIT)
}
