//! Estimates from many values without keeping them: intervals by resampling blocks of scenarios.
//!
//! The percentile bootstrap of [`Estimate::of`] draws 2000 samples of all values, which takes too long and
//! too much memory for millions of them. Here blocks of consecutive scenarios are resampled: in each of the
//! 2000 samples, a block counts as often as a draw from the Poisson distribution with mean 1 says (the
//! Poisson bootstrap). Values pass by once. Scenarios of a block often come from one drive, so that the
//! intervals are rather wider than those of scenarios resampled one by one.

use rand_chacha::rand_core::Rng;
use reactsim_rollout::{Purpose, stream};

use super::statistics::{Estimate, MIN_FOR_INTERVAL, RESAMPLES, interval};

/// Number of consecutive scenarios in a block.
pub(super) const BLOCK: usize = 512;

/// Estimates that are being computed from values which arrive in the order of the scenarios.
#[derive(Debug)]
pub(super) struct BlockEstimates {
    seed: u64,
    samples: Vec<Sample>,
    block: usize,
}

#[derive(Clone, Debug, Default)]
struct Sample {
    sum: f64,
    count: usize,
    /// Whether all values so far are equal, and the first of them.
    equal: bool,
    first: f64,
    /// Sum and number of the values of the present block.
    open: (f64, f64),
    /// Sum and number of values per resample.
    resampled: Vec<(f64, f64)>,
}

impl BlockEstimates {
    /// Creates empty estimates; the seed determines the weights of the blocks.
    pub(super) fn new(seed: u64) -> Self {
        Self { seed, samples: Vec::new(), block: 0 }
    }

    /// Adds a value of the scenario with this index to one of the estimates. Indices do not decrease.
    pub(super) fn add(&mut self, scenario: usize, estimate: usize, value: f64) {
        if scenario / BLOCK != self.block {
            self.close();
            self.block = scenario / BLOCK;
        }
        if self.samples.len() <= estimate {
            self.samples.resize_with(estimate + 1, Sample::default);
        }
        let sample = &mut self.samples[estimate];
        if sample.count == 0 {
            (sample.equal, sample.first) = (true, value);
        }
        sample.equal &= value == sample.first;
        sample.sum += value;
        sample.count += 1;
        sample.open.0 += value;
        sample.open.1 += 1.0;
    }

    /// Ends the present block.
    fn close(&mut self) {
        let weights = weights(self.seed, self.block);
        for sample in self.samples.iter_mut().filter(|s| s.open.1 > 0.0) {
            sample.resampled.resize(RESAMPLES, (0.0, 0.0));
            let (sum, count) = std::mem::take(&mut sample.open);
            for (resampled, weight) in sample.resampled.iter_mut().zip(&weights) {
                resampled.0 += weight * sum;
                resampled.1 += weight * count;
            }
        }
    }

    /// Returns the estimates by index; those without values are empty.
    pub(super) fn finish(mut self) -> Vec<Estimate> {
        self.close();
        self.samples.into_iter().map(Sample::estimate).collect()
    }
}

impl Sample {
    fn estimate(self) -> Estimate {
        if self.count == 0 {
            return Estimate::default();
        }
        let mean = self.sum / self.count as f64;
        // A resample in which no block counts has no mean.
        let drawn = self.resampled.iter().filter(|(_, n)| *n > 0.0);
        let found = interval(drawn.map(|(sum, n)| sum / n).collect());
        let found = found.filter(|_| self.count >= MIN_FOR_INTERVAL);
        let (low, high) = found.map(|found| if self.equal { (mean, mean) } else { found }).unzip();
        Estimate { mean: Some(mean), low, high, scenarios: self.count }
    }
}

/// Probabilities that a draw from the Poisson distribution with mean 1 is at most 0, 1, 2, …
const CUMULATIVE: [f64; 12] = {
    // 1 / e; the sum of the terms 1 / k! is rounded like any other.
    let (mut term, mut sum, mut k) = (0.367_879_441_171_442_33, 0.0, 0);
    let mut all = [0.0; 12];
    while k < all.len() {
        sum += term;
        all[k] = sum;
        k += 1;
        term /= k as f64;
    }
    all
};

/// Returns how often a block counts in every resample.
fn weights(seed: u64, block: usize) -> Vec<f64> {
    let mut random = stream(seed, &format!("block {block}"), 0, Purpose::Bootstrap);
    let draw = || {
        let uniform = (random.next_u64() >> 11) as f64 / (1_u64 << 53) as f64;
        CUMULATIVE.partition_point(|p| *p <= uniform) as f64
    };
    std::iter::repeat_with(draw).take(RESAMPLES).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_poisson_draws_with_mean_one() {
        let all: Vec<f64> = (0..20).flat_map(|block| weights(3, block)).collect();
        let n = all.len() as f64;
        let mean = all.iter().sum::<f64>() / n;
        let variance = all.iter().map(|w| (w - mean) * (w - mean)).sum::<f64>() / n;
        assert!((mean - 1.0).abs() < 0.02 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
        let none = all.iter().filter(|w| **w == 0.0).count() as f64 / n;
        assert!((none - 0.3679).abs() < 0.01, "{none}");
        assert_eq!(weights(3, 7), weights(3, 7));
        assert_ne!(weights(3, 7), weights(3, 8));
    }

    #[test]
    fn intervals_are_those_of_single_values_if_blocks_are_alike() {
        // 200,000 values, of which a quarter is 1: the standard error of the mean is 0.000968.
        let value = |i: usize| f64::from(u8::from(blake3::hash(&i.to_le_bytes()).as_bytes()[0] < 64));
        let mut estimates = BlockEstimates::new(0);
        (0..200_000).for_each(|i| estimates.add(i, 1, value(i)));
        let all = estimates.finish();
        assert_eq!(all[0], Estimate::default());
        let Estimate { mean: Some(mean), low: Some(low), high: Some(high), scenarios } = all[1] else {
            panic!()
        };
        assert_eq!(scenarios, 200_000);
        assert_eq!(mean, (0..200_000).map(value).sum::<f64>() / 200_000.0);
        let half = 1.96 * 0.000_968;
        // 391 blocks determine the width to about 4 %.
        assert!((mean - low - half).abs() < 0.2 * half && (high - mean - half).abs() < 0.2 * half, "{all:?}");
    }

    #[test]
    fn few_and_equal_values_are_treated_as_without_blocks() {
        let mut estimates = BlockEstimates::new(0);
        (0..4).for_each(|i| estimates.add(600 * i, 0, 0.5));
        (4..9).for_each(|i| estimates.add(600 * i, 1, 0.5));
        let all = estimates.finish();
        assert_eq!((all[0].mean, all[0].low, all[0].scenarios), (Some(0.5), None, 4));
        assert_eq!((all[1].mean, all[1].low, all[1].high), (Some(0.5), Some(0.5), Some(0.5)));
    }
}
