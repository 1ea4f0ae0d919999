//! Samplers on discrete schedules.

use burn::tensor::Tensor;

use super::guide::{Guide, Moment};
use super::schedule::Schedule;

/// Smallest variance of a step's noise, which keeps its root finite.
const MIN_VARIANCE: f64 = 1e-20;

/// Rule by which a sample loses noise.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sampler {
    /// Draws from the posterior distribution (Ho et al., <https://arxiv.org/abs/2006.11239>).
    Ddpm,
    /// Without noise on the way: the start decides (Song et al., <https://arxiv.org/abs/2010.02502>, η = 0).
    Ddim,
}

/// Settings of sampling.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sampling {
    /// Rule.
    pub sampler: Sampler,
    /// Number of steps; those of the schedule at most.
    pub steps: usize,
    /// Magnitude to which clean values are limited on the way; the answer to the last step is not.
    pub limit: f64,
}

/// Weights of a step from x(t) to the mean of the sample before it, and the variance of its noise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Posterior {
    pub clean: f64,
    pub noisy: f64,
    pub variance: f64,
}

impl Posterior {
    /// Returns the weights between two shares of the signal, the noisier one first.
    pub(super) fn between(share: f64, next: f64) -> Self {
        let kept = share / next;
        Self {
            clean: next.sqrt() * (1.0 - kept) / (1.0 - share),
            noisy: kept.sqrt() * (1.0 - next) / (1.0 - share),
            variance: ((1.0 - next) / (1.0 - share) * (1.0 - kept)).max(MIN_VARIANCE),
        }
    }
}

impl Sampling {
    /// Samples clean values.
    ///
    /// `start` is standard normal noise. `denoise` returns the clean values that the network finds in noisy
    /// ones at a step; its last answer is the result. `noise` returns standard normal noise of the same shape
    /// and is not called by [`Sampler::Ddim`].
    pub fn sample<const D: usize>(
        &self,
        schedule: &Schedule,
        start: Tensor<D>,
        mut denoise: impl FnMut(Tensor<D>, usize) -> Tensor<D>,
        mut noise: impl FnMut() -> Tensor<D>,
        guide: &mut impl Guide<D>,
    ) -> Tensor<D> {
        let mut x = start;
        let steps = schedule.spaced(self.steps);
        for (i, &step) in steps.iter().enumerate() {
            let clean = denoise(x.clone(), step);
            let Some(&next) = steps.get(i + 1) else { return clean };
            let (mean, deviation) = self.mean(x, &clean, schedule.share(step), schedule.share(next));
            x = guide.guide(mean, &clean, Moment { step, deviation });
            if deviation > 0.0 {
                x = x + noise() * deviation;
            }
        }
        x
    }

    /// Returns the mean of the next sample and the standard deviation of its noise.
    pub(super) fn mean<const D: usize>(
        &self,
        x: Tensor<D>,
        clean: &Tensor<D>,
        share: f64,
        next: f64,
    ) -> (Tensor<D>, f64) {
        let limited = clean.clone().clamp(-self.limit, self.limit);
        match self.sampler {
            Sampler::Ddpm => {
                let weights = Posterior::between(share, next);
                (limited * weights.clean + x * weights.noisy, weights.variance.sqrt())
            }
            Sampler::Ddim => {
                // The noise that the answer implies is that before the limit, as published.
                let noise = (x - clean.clone() * share.sqrt()) / (1.0 - share).sqrt();
                (limited * next.sqrt() + noise * (1.0 - next).sqrt(), 0.0)
            }
        }
    }
}
