//! What is predicted of an agent, as others use it.

use reactsim::dynamics::Pose;
use reactsim::geometry::{Vec2, math};
use reactsim::scene::DT;

use super::inputs::{Frame2, Surroundings};
use super::network::{Config, STATE, suppress};
use super::spline::through;

/// Bounds of the logarithms of deviations, and of the correlation, as in learning: 0.2 to 148 m.
pub(super) const LOG_DEVIATION: (f64, f64) = (-1.609, 5.0);
pub(super) const CORRELATION: f64 = 0.5;
/// Deviation of where an agent is now, metres.
const NOW: f64 = 0.05;

/// Where an agent may be at an instant: a normal distribution.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModePoint {
    /// Mean, metres, scenario frame.
    pub position: Vec2,
    /// Variance along x, covariance, variance along y, m², scenario frame.
    pub covariance: [f64; 3],
}

impl ModePoint {
    /// The standard deviation along a unit vector, metres.
    pub fn deviation(&self, along: Vec2) -> f64 {
        let [xx, xy, yy] = self.covariance;
        (along.x * along.x * xx + 2.0 * along.x * along.y * xy + along.y * along.y * yy).max(0.0).sqrt()
    }
}

/// One thing that an agent may do.
#[derive(Clone, Debug, PartialEq)]
pub struct Mode {
    /// Those of an agent's modes add up to 1.
    pub probability: f64,
    /// 80 points, after 0.1 s to 8 s.
    pub points: Vec<ModePoint>,
}

/// What is predicted of an agent.
#[derive(Clone, Debug, PartialEq)]
pub struct Prediction {
    /// Its slot.
    pub slot: usize,
    /// Its pose now.
    pub pose: Pose,
    /// Its velocity now, m/s, scenario frame.
    pub velocity: Vec2,
    /// The most probable first; none where the network says what are no numbers.
    pub modes: Vec<Mode>,
}

/// The modes that are left of the queries of an agent, as indices, and the probabilities of all queries. `scores` are unnormalised
/// log-probabilities, `states` is `[queries, states, 7]`.
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

/// The prediction of one agent from what the network says of it.
pub(super) fn prediction(
    scene: &Surroundings,
    scores: &[f32],
    states: &[f32],
    config: &Config,
) -> Prediction {
    let frame = Frame2::of(scene.pose);
    let velocity = frame.vector_out(scene.velocity());
    let (kept, probabilities) = kept_modes(scores, states, config);
    let width = config.states() * STATE;
    let mut modes = Vec::with_capacity(kept.len());
    for query in kept {
        let said = &states[query * width..(query + 1) * width];
        if probabilities[query].is_finite() && said.iter().all(|v| v.is_finite()) {
            let points = points(said, scene.velocity(), &frame, config);
            modes.push(Mode { probability: probabilities[query], points });
        }
    }
    let total: f64 = modes.iter().map(|m| m.probability).sum();
    modes.iter_mut().for_each(|m| m.probability /= total);
    Prediction { slot: scene.slots.first().copied().unwrap_or_default(), pose: scene.pose, velocity, modes }
}

/// The points of a mode at 10 Hz.
fn points(said: &[f32], velocity: Vec2, frame: &Frame2, config: &Config) -> Vec<ModePoint> {
    let states: Vec<[f64; STATE]> = said.as_chunks::<STATE>().0.iter().map(|s| s.map(f64::from)).collect();
    let positions: Vec<Vec2> = states.iter().map(|s| Vec2::new(s[0], s[1])).collect();
    let deviations = |s: &[f64; STATE]| {
        let deviation = |l: f64| math::exp(l.clamp(LOG_DEVIATION.0, LOG_DEVIATION.1));
        [deviation(s[2]), deviation(s[3]), s[4].clamp(-CORRELATION, CORRELATION)]
    };
    let spread: Vec<[f64; 3]> = states.iter().map(deviations).collect();
    let (x, y) = (frame.vector_out(Vec2::x()), frame.vector_out(Vec2::y()));
    let smooth = through(&positions, velocity * DT, config.step);
    let of = |(k, p): (usize, Vec2)| {
        // Deviations in between are on a line; that of now is small.
        let (next, part) = (k / config.step, ((k % config.step) + 1) as f64 / config.step as f64);
        let from = next.checked_sub(1).map_or([NOW, NOW, 0.0], |i| spread[i]);
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
