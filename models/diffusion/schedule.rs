//! Discrete noise schedules.

use burn::tensor::Tensor;
use reactsim_geometry::math;

/// Upper bound of the variance that one step adds.
const MAX_VARIANCE: f64 = 0.999;
/// Offset of the cosine schedule, which keeps the first steps small (Nichol and Dhariwal,
/// <https://arxiv.org/abs/2102.09672>).
const OFFSET: f64 = 0.008;
/// Smallest share of the signal.
const MIN_SHARE: f64 = 1e-9;

/// Shares of signal and noise by step: at step t, x(t) = √share · x0 + √(1 - share) · noise.
#[derive(Clone, Debug, PartialEq)]
pub struct Schedule {
    /// Share of the variance that is signal, by step; it decreases.
    shares: Vec<f64>,
}

/// Error of a schedule that cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error(
    "a noise schedule of {steps} steps whose first and last share of signal are {first} and {last}: expected \
         at least one step and shares that decrease between 1 and 0"
)]
pub struct ScheduleError {
    steps: usize,
    first: f64,
    last: f64,
}

impl Schedule {
    /// Returns the cosine schedule of this number of steps, as VBD uses it.
    ///
    /// # Errors
    /// [`ScheduleError`] without steps.
    pub fn cosine(steps: usize) -> Result<Self, ScheduleError> {
        let curve = |t: f64| {
            let cosine = math::cos((t + OFFSET) / (1.0 + OFFSET) * std::f64::consts::FRAC_PI_2);
            cosine * cosine
        };
        let share = |i: usize| (curve(i as f64 / steps as f64) / curve(0.0)).clamp(MIN_SHARE, 1.0);
        let mut left = 1.0;
        let shares = (0..steps).map(|i| {
            left *= 1.0 - (1.0 - share(i + 1) / share(i)).min(MAX_VARIANCE);
            left
        });
        Self::new(shares.collect())
    }

    /// Returns a schedule with these shares of the signal, by step.
    ///
    /// # Errors
    /// [`ScheduleError`] if there are none, or if they do not decrease between 1 and 0.
    pub fn new(shares: Vec<f64>) -> Result<Self, ScheduleError> {
        let is_share = |share: &f64| *share > 0.0 && *share < 1.0;
        if shares.is_empty() || !shares.iter().all(is_share) || !shares.is_sorted_by(|a, b| a > b) {
            let [first, last] = [shares.first(), shares.last()].map(|s| s.copied().unwrap_or(f64::NAN));
            return Err(ScheduleError { steps: shares.len(), first, last });
        }
        Ok(Self { shares })
    }

    /// Returns the number of steps.
    pub fn steps(&self) -> usize {
        self.shares.len()
    }

    /// Returns the share of the variance that is signal at a step.
    pub fn share(&self, step: usize) -> f64 {
        self.shares[step]
    }

    /// Adds noise of standard normal distribution, as much as a step has.
    pub fn add_noise<const D: usize>(&self, clean: Tensor<D>, noise: Tensor<D>, step: usize) -> Tensor<D> {
        let share = self.share(step);
        clean * share.sqrt() + noise * (1.0 - share).sqrt()
    }

    /// Returns this number of steps, the noisiest one first, at equal distances; all steps if `count` is at
    /// least as large.
    pub fn spaced(&self, count: usize) -> Vec<usize> {
        let (all, count) = (self.steps(), count.clamp(1, self.steps()));
        (0..count).map(|i| all - 1 - i * all / count).collect()
    }
}
