//! Predictions of an agent, as other modules use them.

use reactsim_geometry::{Vec2, math};
use reactsim_scene::DT;
use reactsim_scene::dynamics::{Pose, motion_through};

use super::inputs::{LocalFrame, Surroundings};
use super::network::{Config, STATE, suppress};

/// Smallest natural logarithm of a standard deviation, in metres, as in training: 0.2 m.
pub(super) const MIN_LOG_DEVIATION: f64 = -1.609;
/// Largest natural logarithm of a standard deviation, in metres, as in training: 148 m.
pub(super) const MAX_LOG_DEVIATION: f64 = 5.0;
/// Largest magnitude of the correlation, as in training.
pub(super) const MAX_CORRELATION: f64 = 0.5;
/// Standard deviation of the present position, metres.
const PRESENT_DEVIATION: f64 = 0.05;

/// Position of an agent at an instant, as a normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModePoint {
    /// Mean, metres, in the scenario frame.
    pub position: Vec2,
    /// Variance along x, covariance, variance along y, m², in the scenario frame.
    pub covariance: [f64; 3],
}

impl ModePoint {
    /// Returns the standard deviation along a unit vector, metres.
    pub fn deviation(&self, along: Vec2) -> f64 {
        let [xx, xy, yy] = self.covariance;
        (along.x * along.x * xx + 2.0 * along.x * along.y * xy + along.y * along.y * yy).max(0.0).sqrt()
    }
}

/// A predicted trajectory of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Probability; those of an agent's modes add up to 1.
    pub probability: f64,
    /// 80 points, after 0.1 s to 8 s.
    pub points: Vec<ModePoint>,
}

/// Prediction of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Slot of the agent.
    pub slot: usize,
    /// Present pose.
    pub pose: Pose,
    /// Present velocity, m/s, in the scenario frame.
    pub velocity: Vec2,
    /// Modes, the most probable first; empty if the network output is not finite.
    pub modes: Vec<Mode>,
}

/// Returns the query indices of the modes that remain after suppression, and the probabilities of all
/// queries. `scores` are unnormalised log-probabilities, `states` is `[queries, states, 7]`.
pub(super) fn kept_modes(scores: &[f32], states: &[f32], config: &Config) -> (Vec<usize>, Vec<f64>) {
    let largest = scores.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let weights: Vec<f64> = scores.iter().map(|s| math::exp(f64::from(s - largest))).collect();
    let total: f64 = weights.iter().sum();
    let probabilities: Vec<f64> = weights.iter().map(|w| w / total).collect();
    let end = |query: &[f32]| {
        let last = &query[query.len() - STATE..];
        [f64::from(last[0]), f64::from(last[1])]
    };
    let ends: Vec<[f64; 2]> = states.chunks_exact(config.states() * STATE).map(end).collect();
    (suppress(&ends, &probabilities, config.apart, config.modes), probabilities)
}

/// Converts the network output of one agent to a prediction.
pub(super) fn prediction(
    scene: &Surroundings,
    scores: &[f32],
    states: &[f32],
    config: &Config,
) -> Prediction {
    let frame = LocalFrame::of(scene.pose);
    let velocity = frame.vector_out(scene.velocity());
    let (kept, probabilities) = kept_modes(scores, states, config);
    let width = config.states() * STATE;
    let mut modes = Vec::with_capacity(kept.len());
    for query in kept {
        let output = &states[query * width..(query + 1) * width];
        if probabilities[query].is_finite() && output.iter().all(|v| v.is_finite()) {
            let points = points(output, scene.velocity(), &frame, config);
            modes.push(Mode { probability: probabilities[query], points });
        }
    }
    let total: f64 = modes.iter().map(|m| m.probability).sum();
    modes.iter_mut().for_each(|m| m.probability /= total);
    Prediction { slot: scene.slots.first().copied().unwrap_or_default(), pose: scene.pose, velocity, modes }
}

/// Returns the points of a mode at 10 Hz.
fn points(output: &[f32], velocity: Vec2, frame: &LocalFrame, config: &Config) -> Vec<ModePoint> {
    let states: Vec<[f64; STATE]> = output.as_chunks::<STATE>().0.iter().map(|s| s.map(f64::from)).collect();
    let positions: Vec<Vec2> = states.iter().map(|s| Vec2::new(s[0], s[1])).collect();
    let deviations = |s: &[f64; STATE]| {
        let deviation = |l: f64| math::exp(l.clamp(MIN_LOG_DEVIATION, MAX_LOG_DEVIATION));
        [deviation(s[2]), deviation(s[3]), s[4].clamp(-MAX_CORRELATION, MAX_CORRELATION)]
    };
    let spread: Vec<[f64; 3]> = states.iter().map(deviations).collect();
    let (x, y) = (frame.vector_out(Vec2::x()), frame.vector_out(Vec2::y()));
    let smooth = motion_through(&positions, velocity * DT, config.step);
    let of = |(k, p): (usize, Vec2)| {
        // Deviations are interpolated linearly; that of the present is small.
        let (next, part) = (k / config.step, ((k % config.step) + 1) as f64 / config.step as f64);
        let from = next.checked_sub(1).map_or([PRESENT_DEVIATION, PRESENT_DEVIATION, 0.0], |i| spread[i]);
        let [sx, sy, rho] = std::array::from_fn(|i| from[i] + (spread[next][i] - from[i]) * part);
        let (xx, xy, yy) = (sx * sx, rho * sx * sy, sy * sy);
        let about = |a: Vec2, b: Vec2, i: usize, j: usize| {
            a[i] * a[j] * xx + (a[i] * b[j] + b[i] * a[j]) * xy + b[i] * b[j] * yy
        };
        let covariance = [about(x, y, 0, 0), about(x, y, 0, 1), about(x, y, 1, 1)];
        ModePoint { position: frame.point_out(p), covariance }
    };
    smooth.into_iter().enumerate().map(of).collect()
}
