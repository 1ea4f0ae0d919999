//! AdamW on a list of numbers.

use super::Settings;
use super::parameters::Layout;
use crate::geometry::math::pow;

/// The moments of AdamW (Loshchilov and Hutter, "Decoupled Weight Decay Regularization", <https://arxiv.org/abs/1711.05101>).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AdamW {
    pub(super) first: Vec<f32>,
    pub(super) second: Vec<f32>,
    /// Updates so far.
    pub(super) updates: u64,
}

impl AdamW {
    pub(super) fn new(len: usize) -> Self {
        Self { first: vec![0.0; len], second: vec![0.0; len], updates: 0 }
    }

    /// Moves the values against the gradient.
    pub(super) fn update(
        &mut self,
        settings: &Settings,
        layout: &Layout,
        rate: f64,
        values: &mut [f32],
        gradient: &[f32],
    ) {
        self.updates += 1;
        let [beta1, beta2] = settings.betas;
        let unbiased = |beta: f64| 1.0 - pow(beta, self.updates as f64);
        let step = (rate / unbiased(beta1)) as f32;
        let root = (1.0 / unbiased(beta2).sqrt()) as f32;
        let (b1, b2, epsilon) = (beta1 as f32, beta2 as f32, settings.epsilon as f32);
        for parameter in &layout.parameters {
            let keep = if parameter.decays() { (1.0 - rate * settings.weight_decay) as f32 } else { 1.0 };
            let range = parameter.range.clone();
            let moments = self.first[range.clone()].iter_mut().zip(&mut self.second[range.clone()]);
            let numbers = values[range.clone()].iter_mut().zip(&gradient[range]);
            for ((m, v), (x, g)) in moments.zip(numbers) {
                *m = b1 * *m + (1.0 - b1) * g;
                *v = b2 * *v + (1.0 - b2) * g * g;
                *x = keep * *x - step * *m / (v.sqrt() * root + epsilon);
            }
        }
    }
}
