//! Motion from normalised actions.

use burn::tensor::{Device, Tensor, TensorData};
use reactsim_geometry::wrap;
use reactsim_scene::AgentState;

use super::unicycle::roll_out;

/// Deviation of accelerations, m/s², and yaw rates, rad/s: normalised actions have deviation 1 (VBD).
const DEVIATIONS: [f32; 2] = [1.0, 0.15];

/// Returns an action, m/s² and rad/s, normalised.
pub fn normalized([acceleration, yaw_rate]: [f64; 2]) -> [f32; 2] {
    [acceleration as f32 / DEVIATIONS[0], yaw_rate as f32 / DEVIATIONS[1]]
}

/// Returns normalised actions, `[n, actions, 2]`, in m/s² and rad/s.
pub fn unnormalized(actions: Tensor<3>) -> Tensor<3> {
    let deviations = Tensor::<1>::from_data(TensorData::from(DEVIATIONS), &actions.device());
    actions * deviations.reshape([1, 1, 2])
}

/// Returns the states to which normalised actions, `[n, actions, 2]`, each held for `hold` steps, lead from
/// speeds, `[n, 1]`, m/s, each agent starting at the origin of its frame: `[n, states, 5]`, as [`roll_out`]
/// returns them.
pub fn own_motion(actions: Tensor<3>, speeds: &Tensor<2>, hold: usize) -> Tensor<3> {
    let agents = speeds.dims()[0];
    let nothing = |columns| Tensor::<2>::zeros([agents, columns], &speeds.device());
    let start = Tensor::cat(vec![nothing(3), speeds.clone(), nothing(1)], 1);
    roll_out(&start, unnormalized(actions), hold)
}

/// Returns the states to which normalised actions, `[n, actions, 2]`, lead agents from these states, `[n,
/// states, 5]`: headings and velocities of the scene, positions from where each agent is, where single
/// precision is finest.
pub fn motion_from(now: &[AgentState], actions: Tensor<3>, hold: usize, device: &Device) -> Tensor<3> {
    let start = |s: &AgentState| [0.0, 0.0, s.heading as f32, s.vx as f32, s.vy as f32];
    let starts: Vec<f32> = now.iter().flat_map(start).collect();
    let starts = Tensor::<2>::from_data(TensorData::new(starts, [now.len(), 5]), device);
    roll_out(&starts, unnormalized(actions), hold)
}

/// Returns what [`motion_from`] found, in the scene: states by agent.
pub fn states_of(now: &[AgentState], motion: Tensor<3>) -> Vec<Vec<AgentState>> {
    let states = motion.dims()[1];
    let values: Vec<f32> = motion.into_data().iter::<f32>().collect();
    let of_agent = |(own, now): (&[f32], &AgentState)| {
        let state = |s: &[f32]| {
            let [x, y, yaw, vx, vy] = [s[0], s[1], s[2], s[3], s[4]].map(f64::from);
            AgentState { x: now.x + x, y: now.y + y, heading: wrap(yaw), vx, vy }
        };
        own.chunks(5).map(state).collect()
    };
    values.chunks(5 * states.max(1)).zip(now).map(of_agent).collect()
}

#[cfg(test)]
mod tests {
    use reactsim_nn::device;

    use super::*;

    #[test]
    fn agents_move_from_where_they_are() {
        let device = device();
        let heading = std::f64::consts::FRAC_PI_2;
        let now = [AgentState { x: 3.0, y: -2.0, heading, vx: 0.0, vy: 4.0 }];
        // One second at 2 m/s² and 0 rad/s.
        let action = normalized([2.0, 0.0]);
        let actions = Tensor::<3>::from_data(TensorData::new(action.repeat(2), [1, 2, 2]), &device);
        let states = states_of(&now, motion_from(&now, actions.clone(), 5, &device));
        let last = states[0][9];
        assert!((last.vy - 6.0).abs() < 1e-5 && last.vx.abs() < 1e-5, "{last:?}");
        // The mean of the speeds at the ends of ten steps is 5.1 m/s.
        assert!((last.x - 3.0).abs() < 1e-5 && (last.y - 3.1).abs() < 1e-4, "{last:?}");
        // In its own frame the same motion leads straight ahead.
        let speeds = Tensor::from_data(TensorData::new(vec![4.0f32], [1, 1]), &device);
        let own: Vec<f32> = own_motion(actions, &speeds, 5).into_data().iter::<f32>().collect();
        assert!((own[45] - 5.1).abs() < 1e-4 && own[46].abs() < 1e-5, "{own:?}");
    }
}
