//! Guidance of the sampler by rules.

use burn::tensor::{Tensor, TensorData};
use reactsim_geometry::Vec2;
use reactsim_scene::AgentState;

use super::{Cost, Motion, RuleScene};
use crate::{Guide, Moment, motion_from};

/// Largest change of a normalised action per step (the learning rate of the public code).
const LEARNING_RATE: f64 = 0.3;

/// Changes the mean of every step against the gradient of the rules' costs, through the motion that the
/// actions lead to.
pub(crate) struct RuleGuide<'a> {
    pub(crate) scene: &'a RuleScene<'a>,
    /// Current states of the agents.
    pub(crate) now: &'a [AgentState],
    /// Number of steps of 0.1 s for which an action is held.
    pub(crate) hold: usize,
}

impl RuleGuide<'_> {
    /// Returns the costs of each agent if all act like this, normalised actions `[n, actions, 2]`.
    pub(crate) fn costs(&self, actions: Tensor<3>) -> Vec<Cost> {
        let device = actions.device();
        self.scene.costs(&self.motion(motion_from(self.now, actions, self.hold, &device)))
    }

    /// Returns motion in the scene from states, `[n, states, 5]`, whose positions are from where each agent
    /// is.
    fn motion(&self, states: Tensor<3>) -> Vec<Vec<Motion>> {
        let count = states.dims()[1];
        let states: Vec<f32> = states.into_data().iter::<f32>().collect();
        let of_agent = |(own, now): (&[f32], &AgentState)| {
            let state = |s: &[f32]| {
                let [x, y, heading, vx, vy] = [s[0], s[1], s[2], s[3], s[4]].map(f64::from);
                Motion { at: now.position() + Vec2::new(x, y), heading, velocity: Vec2::new(vx, vy) }
            };
            own.chunks(5).map(state).collect()
        };
        states.chunks(5 * count).zip(self.now).map(of_agent).collect()
    }
}

/// Returns derivatives of costs by states, `[n, states, 5]`.
fn slopes(costs: &[Cost]) -> Vec<f32> {
    let all = costs.iter().flat_map(|cost| &cost.gradient);
    let of_state = |by: &Motion| [by.at.x, by.at.y, by.heading, by.velocity.x, by.velocity.y];
    all.flat_map(of_state).map(|value| value as f32).collect()
}

impl Guide<3> for RuleGuide<'_> {
    /// One step of Adam, which begins with a step of the learning rate in the direction of the sign, and of
    /// the noise's deviation at most, as published.
    fn guide(&mut self, mean: Tensor<3>, _: &Tensor<3>, moment: Moment) -> Tensor<3> {
        if !self.scene.rules.any() {
            return mean;
        }
        let device = mean.device();
        let learning = device.clone().autodiff();
        let leaf = Tensor::<3>::from_data(mean.clone().into_data(), &learning).require_grad();
        let states = motion_from(self.now, leaf.clone(), self.hold, &learning);
        let costs = self.scene.costs(&self.motion(states.clone().inner()));
        if costs.iter().all(|cost| cost.value == 0.0) {
            return mean;
        }
        let shape = states.dims();
        let slopes = Tensor::<3>::from_data(TensorData::new(slopes(&costs), shape), &learning);
        let gradients = (states * slopes).sum().backward();
        let Some(gradient) = leaf.grad(&gradients) else { return mean };
        let sizes = gradient.clone().abs() + 1e-8;
        let step = (gradient / sizes) * LEARNING_RATE.min(moment.deviation);
        mean - Tensor::from_data(step.into_data(), &device)
    }
}
