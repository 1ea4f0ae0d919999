//! A fast solver in continuous time, as Diffusion-Planner samples.

use burn::tensor::Tensor;
use reactsim_geometry::math;

use super::guide::{Guide, Moment};

/// The variance-preserving process with a rate of noise that grows linearly (Song et al.,
/// <https://arxiv.org/abs/2011.13456>): x(t) = signal · x0 + deviation · noise, t from 0 to 1.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VariancePreserving {
    /// Rate of noise at t = 0.
    pub first: f64,
    /// Rate of noise at t = 1.
    pub last: f64,
}

impl Default for VariancePreserving {
    /// Returns the rates of the public code.
    fn default() -> Self {
        Self { first: 0.1, last: 20.0 }
    }
}

impl VariancePreserving {
    /// Returns the natural logarithm of the signal's factor.
    fn log_signal(&self, t: f64) -> f64 {
        -0.25 * t * t * (self.last - self.first) - 0.5 * t * self.first
    }

    /// Returns the factor of the signal.
    pub fn signal(&self, t: f64) -> f64 {
        math::exp(self.log_signal(t))
    }

    /// Returns the standard deviation of the noise.
    pub fn deviation(&self, t: f64) -> f64 {
        // 1 - exp(y) loses all digits where y is near 0.
        (-libm::expm1(2.0 * self.log_signal(t))).sqrt()
    }

    /// Returns the logarithm of the ratio of signal to noise, which decreases with t.
    pub fn log_ratio(&self, t: f64) -> f64 {
        self.log_signal(t) - math::ln(self.deviation(t))
    }

    /// Returns the time at which the logarithm of the ratio of signal to noise has a value.
    pub fn time(&self, log_ratio: f64) -> f64 {
        // The logarithm of the signal, then a quadratic equation.
        let log_signal = -0.5 * libm::log1p(math::exp(-2.0 * log_ratio));
        let slope = self.last - self.first;
        let root = (self.first * self.first - 4.0 * slope * log_signal).sqrt();
        -4.0 * log_signal / (root + self.first)
    }
}

/// Samples by DPM-Solver++ of second order (Lu et al., <https://arxiv.org/abs/2211.01095>): `steps` steps at
/// equal distances of the logarithm of the ratio of signal to noise, from t = 1 to `end`, and one last answer
/// there.
///
/// `start` is noise of the wanted deviation. `denoise` returns the clean values found in noisy ones at a
/// time. `guide` sees every sample; [`Moment::step`] counts them from 0.
pub fn solve<const D: usize>(
    process: &VariancePreserving,
    steps: usize,
    end: f64,
    start: Tensor<D>,
    mut denoise: impl FnMut(Tensor<D>, f64) -> Tensor<D>,
    guide: &mut impl Guide<D>,
) -> Tensor<D> {
    let (from, to) = (process.log_ratio(1.0), process.log_ratio(end));
    let ratio = |i: usize| from + (to - from) * i as f64 / steps as f64;
    let mut x = start;
    let (mut t, mut before): (f64, Option<Tensor<D>>) = (1.0, None);
    for i in 0..steps {
        let clean = denoise(x.clone(), t);
        let next = if i + 1 == steps { end } else { process.time(ratio(i + 1)) };
        // Distances are equal, so the slope is the difference to the answer before.
        let towards = match before.take() {
            Some(before) => clean.clone() * 1.5 - before * 0.5,
            None => clean.clone(),
        };
        let step = ratio(i + 1) - ratio(i);
        x = x * (process.deviation(next) / process.deviation(t))
            - towards * (process.signal(next) * libm::expm1(-step));
        x = guide.guide(x, &clean, Moment { step: i, deviation: 0.0 });
        (t, before) = (next, Some(clean));
    }
    denoise(x, t)
}
