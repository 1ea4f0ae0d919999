//! Motion from actions, as operations with gradients.

use burn::tensor::Tensor;
use reactsim_scene::DT;

/// Drives agents by actions (a unicycle; Versatile Behavior Diffusion, <https://arxiv.org/abs/2404.02524>).
///
/// - `start`, `[n, 5]`: x, y (m), yaw (rad), vx, vy (m/s).
/// - `actions`, `[n, count, 2]`: acceleration (m/s²) and yaw rate (rad/s), each held for `hold` steps of 0.1
///   s.
///
/// Returns the states after each step, `[n, count * hold, 5]`, in the frame of the start. Yaws are not
/// wrapped. Speeds are limited to 0 and more after accelerations were added up, as published: an agent that
/// stands first pays back what it braked beyond its halt.
pub fn roll_out(start: &Tensor<2>, actions: Tensor<3>, hold: usize) -> Tensor<3> {
    let [n, count, _] = actions.dims();
    let steps = count * hold;
    let column = |k: usize| {
        let held = actions.clone().narrow(2, k, 1).repeat_dim(2, hold);
        held.reshape([n, steps])
    };
    let of = |k: usize| start.clone().narrow(1, k, 1);
    let (vx, vy) = (of(3), of(4));
    let first = (vx.clone() * vx + vy.clone() * vy).sqrt();
    let speed = (column(0).cumsum(1) * DT + first).clamp_min(0.0);
    let yaw = column(1).cumsum(1) * DT + of(2);
    let (vx, vy) = (speed.clone() * yaw.clone().cos(), speed * yaw.clone().sin());
    let x = vx.clone().cumsum(1) * DT + of(0);
    let y = vy.clone().cumsum(1) * DT + of(1);
    Tensor::stack::<3>(vec![x, y, yaw, vx, vy], 2)
}
