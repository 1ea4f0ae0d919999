//! Trajectories: states and actions, normalised.

use burn::tensor::Tensor;

use super::config::CtgConfig;
use crate::own_motion;

/// Numbers of a step of a trajectory: x, y, speed, yaw, acceleration, yaw rate, all normalised.
pub(crate) const NUMBERS: usize = 6;
/// Centre and deviation of x (m), y (m), speed (m/s) and yaw (rad) in plans of 4 s.
const STATES: [[f32; 2]; 4] = [[10.0, 12.0], [0.0, 2.0], [5.0, 5.0], [0.0, 0.3]];

/// Normalises x (m), y (m), speed (m/s) and yaw (rad) of a state.
pub(crate) fn normalized_state(state: [f32; 4]) -> [f32; 4] {
    std::array::from_fn(|k| (state[k] - STATES[k][0]) / STATES[k][1])
}

/// Returns the states of trajectories, `[n, actions, 6]`, in metres, m/s and radians, `[n, actions, 4]`.
pub(crate) fn unnormalized_states(trajectories: Tensor<3>) -> Tensor<3> {
    let state = |k: usize| trajectories.clone().narrow(2, k, 1) * STATES[k][1] + STATES[k][0];
    Tensor::cat((0..4).map(state).collect(), 2)
}

/// Returns the trajectory of normalised actions, `[n, actions, 2]`, from speeds, `[n, 1]`, m/s: the states at
/// the ends of actions with the actions, normalised, `[n, actions, 6]`.
pub(crate) fn trajectory(actions: Tensor<3>, speeds: &Tensor<2>, config: &CtgConfig) -> Tensor<3> {
    let n = actions.dims()[0];
    let states = own_motion(actions.clone(), speeds, config.hold);
    let ends = states.reshape([n, config.actions, config.hold, 5]).narrow(2, config.hold - 1, 1);
    let ends: Tensor<3> = ends.reshape([n, config.actions, 5]);
    let column = |k: usize| ends.clone().narrow(2, k, 1);
    // Speeds are not negative; the square of a speed of 0 would have no gradient of its root.
    let (vx, vy) = (column(3), column(4));
    let speed = (vx.clone() * vx + vy.clone() * vy + 1e-6).sqrt();
    let columns = [column(0), column(1), speed, column(2)];
    let normalized = columns.into_iter().zip(STATES).map(|(x, [center, deviation])| (x - center) / deviation);
    let mut all: Vec<Tensor<3>> = normalized.collect();
    all.push(actions);
    Tensor::cat(all, 2)
}
