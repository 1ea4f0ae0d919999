//! Means over scenarios with bootstrap intervals.

pub(crate) mod comparison;
pub(crate) mod samples;
pub(crate) mod tally;

use rand_chacha::rand_core::Rng;
use reactsim_rollout::{Purpose, Stream, stream};
use serde::{Deserialize, Serialize};

/// Number of bootstrap resamples.
pub(super) const RESAMPLES: usize = 2000;
/// Number of bootstrap resamples of more than [`MANY`] values, of which 2000 would take hours.
pub(super) const RESAMPLES_OF_MANY: usize = 200;
/// Largest number of values with [`RESAMPLES`].
pub(super) const MANY: usize = 100_000;
/// Probability below a 95 % interval, and above it.
const TAIL: f64 = 0.025;

/// Number of scenarios below which an estimate has no interval: the resampled means of so few values say
/// nothing about other scenarios.
pub(super) const MIN_FOR_INTERVAL: usize = 5;

/// A mean over scenarios with its 95 % percentile bootstrap interval. All are `None` if no scenario has a
/// value; with fewer than 5 scenarios there is no interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Estimate {
    /// Unweighted mean over the scenarios with a value.
    pub mean: Option<f64>,
    /// 2.5 % percentile of the resampled means.
    pub low: Option<f64>,
    /// 97.5 % percentile of the resampled means.
    pub high: Option<f64>,
    /// Number of scenarios with a value.
    pub scenarios: usize,
}

impl Estimate {
    /// Computes the estimate from one value per scenario, in a fixed order. Seed and metric select the random
    /// stream of the resampling.
    pub fn of(values: &[f64], seed: u64, metric: &str) -> Self {
        if values.is_empty() {
            return Self::default();
        }
        let n = values.len() as f64;
        let mean = values.iter().sum::<f64>() / n;
        if values.len() < MIN_FOR_INTERVAL {
            return Self { mean: Some(mean), low: None, high: None, scenarios: values.len() };
        }
        // If all values are equal, all resampled means are equal up to rounding.
        let interval = if values.iter().all(|v| *v == values[0]) {
            Some((mean, mean))
        } else {
            let mut random = stream(seed, metric, 0, Purpose::Bootstrap);
            let mut draw = || values[below(&mut random, values.len())];
            let resamples = if values.len() > MANY { RESAMPLES_OF_MANY } else { RESAMPLES };
            interval((0..resamples).map(|_| values.iter().map(|_| draw()).sum::<f64>() / n).collect())
        };
        let (low, high) = interval.unzip();
        Self { mean: Some(mean), low, high, scenarios: values.len() }
    }
}

/// Returns the mean of values; `None` without values.
pub(super) fn mean(values: impl Iterator<Item = f64>) -> Option<f64> {
    let (sum, n) = values.fold((0.0, 0_u32), |(sum, n), v| (sum + v, n + 1));
    (n > 0).then(|| sum / f64::from(n))
}

/// Draws a uniform index below `n`: the high half of a product (the bias is below n / 2^64).
pub(super) fn below(random: &mut Stream, n: usize) -> usize {
    ((u128::from(random.next_u64()) * n as u128) >> 64) as usize
}

/// Returns the 95 % percentile interval of the values of resamples, in any order; `None` without values.
pub(super) fn interval(mut resampled: Vec<f64>) -> Option<(f64, f64)> {
    resampled.sort_by(f64::total_cmp);
    (!resampled.is_empty()).then(|| (quantile(&resampled, TAIL), quantile(&resampled, 1.0 - TAIL)))
}

/// Returns a quantile of sorted values, interpolated linearly.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = q * (sorted.len() - 1) as f64;
    let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    low + (high - low) * (at - at.floor())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_values_give_no_estimate() {
        assert_eq!(Estimate::of(&[], 0, "ade"), Estimate::default());
    }

    #[test]
    fn few_scenarios_have_no_interval() {
        let few = Estimate::of(&[0.25; 4], 0, "ade");
        assert_eq!((few.mean, few.low, few.high, few.scenarios), (Some(0.25), None, None, 4));
        let enough = Estimate::of(&[0.25; 5], 0, "ade");
        assert_eq!((enough.mean, enough.low, enough.high), (Some(0.25), Some(0.25), Some(0.25)));
    }

    #[test]
    fn interval_matches_the_standard_error() {
        // 400 values, half 0 and half 1: the standard error of the mean is 0.025.
        let values: Vec<f64> = (0..400).map(|i| f64::from(i % 2)).collect();
        let e = Estimate::of(&values, 0, "ade");
        assert_eq!(e.mean, Some(0.5));
        assert!((e.low.unwrap() - (0.5 - 1.96 * 0.025)).abs() < 0.005, "{e:?}");
        assert!((e.high.unwrap() - (0.5 + 1.96 * 0.025)).abs() < 0.005, "{e:?}");
        assert_eq!(e, Estimate::of(&values, 0, "ade"));
        assert_ne!(e, Estimate::of(&values, 1, "ade"));
        assert_ne!(e, Estimate::of(&values, 0, "offroad"));
    }

    #[test]
    fn intervals_of_many_values_are_those_of_fewer_resamples() {
        let values: Vec<f64> = (0..=MANY).map(|i| f64::from(u8::from(i % 4 == 0))).collect();
        let Estimate { mean: Some(mean), low: Some(low), high: Some(high), .. } =
            Estimate::of(&values, 0, "ade")
        else {
            panic!()
        };
        let half = 1.96 * (0.25_f64 * 0.75 / MANY as f64).sqrt();
        assert!((mean - low - half).abs() < 0.3 * half && (high - mean - half).abs() < 0.3 * half);
    }

    #[test]
    fn quantiles_lie_between_neighbours() {
        assert_eq!(quantile(&[0.0, 1.0, 2.0], 0.25), 0.5);
        assert_eq!(quantile(&[3.0], 0.9), 3.0);
    }
}
