//! Guesses that predictions are the difference from.

use burn::tensor::{Tensor, TensorData};
use reactsim::geometry::{Vec2, math};
use reactsim::scene::DT;

use super::STATE;
use super::config::Config;

/// The states of someone who is at the origin with this velocity and drives, at constant acceleration, to `goal` by the end; straight on
/// without a goal. Row by row, as they are predicted, with deviations that grow.
pub(crate) fn guess(velocity: Vec2, goal: Option<Vec2>, config: &Config, out: &mut Vec<f32>) {
    let end = config.states() as f64 * config.step as f64 * DT;
    let rest = goal.map_or_else(Vec2::zeros, |g| g - velocity * end);
    for t in config.times() {
        let u = t / end;
        let at = velocity * t + rest * (u * u);
        let v = velocity + rest * (2.0 * u / end);
        let deviation = math::ln(0.15 + 0.4 * t * t.sqrt().sqrt());
        let state = [at.x, at.y, deviation, deviation, 0.0, v.x, v.y];
        out.extend(state.map(|value| value as f32));
    }
}

/// What a network says, `[n, states, 7]`, as a difference from guesses `[n, states, 7]`: the later the state, the more a number of the
/// network is worth.
pub(crate) fn applied(said: Tensor<3>, guesses: Tensor<3>, config: &Config) -> Tensor<3> {
    let mut worth = Vec::with_capacity(config.states() * STATE);
    for t in config.times() {
        let (place, speed) = (0.4 * t * t.sqrt(), 0.5 + 0.25 * t);
        worth.extend([place, place, 1.0, 1.0, 1.0, speed, speed].map(|value| value as f32));
    }
    let worth = TensorData::new(worth, [1, config.states(), STATE]);
    let worth = Tensor::<3>::from_data(worth, &said.device());
    guesses + said * worth
}
