//! Random values drawn from a stream.

use rand::RngExt;
use reactsim_rollout::Stream;

/// Random draws from a [`Stream`] by plain arithmetic.
pub trait Draw {
    /// Draws a uniform value between the bounds.
    fn uniform(&mut self, low: f64, high: f64) -> f64;

    /// Draws a whole number from `low..=high`.
    fn count(&mut self, low: usize, high: usize) -> usize;

    /// Draws from the standard normal distribution (mean 0, standard deviation 1).
    fn normal(&mut self) -> f64;

    /// Draws from the normal distribution with this mean and standard deviation, and again until the value
    /// is within the bounds.
    ///
    /// The bounds must contain a fair share of the distribution, such as two standard deviations about the
    /// mean.
    fn normal_within(&mut self, mean: f64, deviation: f64, low: f64, high: f64) -> f64 {
        loop {
            let value = mean + deviation * self.normal();
            if (low..=high).contains(&value) {
                return value;
            }
        }
    }

    /// Returns true with this probability.
    fn chance(&mut self, probability: f64) -> bool {
        self.uniform(0.0, 1.0) < probability
    }

    /// Draws an index with probability proportional to its weight; the last one if all weights are 0.
    /// `weights` must not be empty.
    fn weighted(&mut self, weights: &[f64]) -> usize {
        let mut left = self.uniform(0.0, 1.0) * weights.iter().sum::<f64>();
        for (i, weight) in weights.iter().enumerate() {
            if left < *weight {
                return i;
            }
            left -= weight;
        }
        weights.len() - 1
    }

    /// Draws one of the items, which must not be empty.
    fn pick<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.count(0, items.len() - 1)]
    }
}

impl Draw for Stream {
    fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.random::<f64>()
    }

    fn count(&mut self, low: usize, high: usize) -> usize {
        self.random_range(low..=high)
    }

    fn normal(&mut self) -> f64 {
        // Irwin-Hall: the sum of twelve uniform values is close enough to normal, and at most 6 deviations
        // off. `math::standard_normal` would change all published scenarios.
        (0..12).map(|_| self.random::<f64>()).sum::<f64>() - 6.0
    }
}

/// Draws from the exponential distribution with mean 1 (von Neumann 1951: by comparisons of uniform values
/// only).
pub(super) fn exponential(rng: &mut Stream) -> f64 {
    let mut whole = 0.0;
    loop {
        let first: f64 = rng.random();
        let mut last = first;
        let mut odd = true;
        loop {
            let next: f64 = rng.random();
            if next > last {
                break;
            }
            last = next;
            odd = !odd;
        }
        if odd {
            return whole + first;
        }
        whole += 1.0;
    }
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};

    use super::*;

    #[test]
    fn normal_has_mean_and_deviation() {
        let mut rng = stream(0, "draw", 0, Purpose::Begin);
        let values: Vec<f64> = (0..20_000).map(|_| rng.normal()).collect();
        let mean = values.iter().sum::<f64>() / 20_000.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!(mean.abs() < 0.03 && (variance - 1.0).abs() < 0.04, "{mean} {variance}");
    }

    #[test]
    fn exponential_has_mean_and_deviation() {
        let mut rng = stream(0, "draw", 2, Purpose::Begin);
        let values: Vec<f64> = (0..20_000).map(|_| exponential(&mut rng)).collect();
        let mean = values.iter().sum::<f64>() / 20_000.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 20_000.0;
        assert!((mean - 1.0).abs() < 0.03 && (variance - 1.0).abs() < 0.08, "{mean} {variance}");
    }

    #[test]
    fn weights_decide() {
        let mut rng = stream(0, "draw", 1, Purpose::Begin);
        assert!((0..100).all(|_| rng.weighted(&[0.0, 2.0, 0.0]) == 1));
    }
}
