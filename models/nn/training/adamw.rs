//! AdamW on a flat list of parameter values.

use reactsim_geometry::math::pow;

use super::Settings;
use super::parameters::{Group, Layout};

/// Moments of AdamW (Loshchilov and Hutter, "Decoupled Weight Decay Regularization",
/// <https://arxiv.org/abs/1711.05101>).
#[derive(Clone, Debug, PartialEq)]
pub(super) struct AdamW {
    pub(super) first: Vec<f32>,
    pub(super) second: Vec<f32>,
    /// Number of updates so far.
    pub(super) updates: u64,
}

impl AdamW {
    pub(super) fn new(len: usize) -> Self {
        Self { first: vec![0.0; len], second: vec![0.0; len], updates: 0 }
    }

    /// Updates the values with a gradient at learning rate `rate`. Averages stay as they are.
    pub(super) fn update(
        &mut self,
        settings: &Settings,
        layout: &Layout,
        rate: f64,
        values: &mut [f32],
        gradient: &[f32],
    ) {
        self.updates += 1;
        let Settings { beta1, beta2, .. } = *settings;
        let unbiased = |beta: f64| 1.0 - pow(beta, self.updates as f64);
        let step = (rate / unbiased(beta1)) as f32;
        let root = (1.0 / unbiased(beta2).sqrt()) as f32;
        let (b1, b2, epsilon) = (beta1 as f32, beta2 as f32, settings.epsilon as f32);
        let (n1, n2) = ((1.0 - beta1) as f32, (1.0 - beta2) as f32);
        for parameter in &layout.parameters {
            let keep = match parameter.group() {
                Group::Decayed => (1.0 - rate * settings.weight_decay) as f32,
                Group::Undecayed => 1.0,
                Group::Average => continue,
            };
            let range = parameter.range.clone();
            let moments = self.first[range.clone()].iter_mut().zip(&mut self.second[range.clone()]);
            let numbers = values[range.clone()].iter_mut().zip(&gradient[range]);
            for ((m, v), (x, g)) in moments.zip(numbers) {
                *m = b1 * *m + n1 * g;
                *v = b2 * *v + n2 * g * g;
                *x = keep * *x - step * *m / (v.sqrt() * root + epsilon);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use burn::nn::LinearConfig;
    use burn::tensor::{Device, Tensor};

    use super::*;
    use crate::training::parameters;

    /// Parameters after steps 1, 10 and 20 of the AdamW of burn-optim 0.22.1 on the same loss.
    #[rustfmt::skip]
    const EXPECTED: [(u8, [f32; 12]); 3] = [
        (0, [
            0.277_157_46, 0.240_351_57, 0.428_217_1, -0.211_919_75, 0.242_231_23, 0.063_662_77,
            0.323_719_98, -0.536_613_2, 0.379_164_58, -0.529_407_7, 0.316_141_46, 0.396_927_74,
        ]),
        (9, [
            0.371_810_7, 0.375_634_25, 0.445_512_77, -0.011_400_921, 0.081_513_29, -0.110_273_734,
            0.210_779_67, -0.641_912_2, -0.274_891_64, -0.126_894, -0.255_951_8, -0.101_037_66,
        ]),
        (19, [
            0.420_983_37, 0.374_419_06, 0.521_614_7, -0.006_828_674, 0.008_004_036, -0.123_301_45,
            0.099_453_494, -0.611_402_45, -0.063_340_11, -0.096_891_88, -0.016_083_328, -0.080_155_76,
        ]),
    ];

    /// Follows another implementation on a non-quadratic loss.
    #[test]
    fn it_agrees_with_another_implementation() {
        let settings = Settings { weight_decay: 0.1, epsilon: 1e-5, ..Settings::default() };
        let device = Device::flex().autodiff();
        let model = LinearConfig::new(3, 4).with_bias(false).init(&device);
        let model = crate::training::draw_parameters(model, 3, 1.0);
        let (layout, mut values) = parameters::read(&model);
        let mut adamw = AdamW::new(layout.len);
        for step in 0..20u8 {
            let rate = 0.01 * f64::from(20 - step);
            let x = Tensor::<2>::from_data([[1.0, -0.5, 0.1 * f32::from(step)]], &device);
            let model = parameters::write(model.clone(), &values);
            let loss = (model.forward(x) - 0.3).powi_scalar(4).sum();
            let gradient = parameters::gradients(&model, loss.backward(), layout.len);
            adamw.update(&settings, &layout, rate, &mut values, &gradient);
            let Some((_, expected)) = EXPECTED.iter().find(|(at, _)| *at == step) else { continue };
            let most = values.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            // The other implementation computes 1 - beta in single precision.
            assert!(most < 1e-4, "step {step}: {most}");
        }
    }

    #[test]
    fn only_matrices_decay() {
        use burn::module::Module;
        use burn::nn::{Embedding, EmbeddingConfig, LayerNorm, LayerNormConfig, Linear};

        #[derive(Module, Debug)]
        struct Net {
            table: Embedding,
            norm: LayerNorm,
            linear: Linear,
            mean: crate::training::Average,
        }
        let device = Device::flex().autodiff();
        let net = Net {
            table: EmbeddingConfig::new(5, 3).init(&device),
            norm: LayerNormConfig::new(3).init(&device),
            linear: LinearConfig::new(3, 2).init(&device),
            mean: crate::training::Average::new(Tensor::zeros([2], &device)),
        };
        let (layout, _) = parameters::read(&net);
        let groups: Vec<(&str, Group)> =
            layout.parameters.iter().map(|p| (p.path.as_str(), p.group())).collect();
        let expected = [
            ("table.weight", Group::Undecayed),
            ("norm.gamma", Group::Undecayed),
            ("norm.beta", Group::Undecayed),
            ("linear.weight", Group::Decayed),
            ("linear.bias", Group::Undecayed),
            ("mean", Group::Average),
        ];
        assert_eq!(groups, expected);
    }
}
