//! Estimators of distributions: smoothed histograms and event probabilities.

use reactsim_geometry::math;

use super::config::Bins;

/// Count added to every bin.
const HISTOGRAM_PSEUDOCOUNT: f64 = 0.1;
/// Count added to both outcomes of an event.
const EVENT_PSEUDOCOUNT: f64 = 0.001;

/// The edges of a histogram in single precision, as the official code computes them.
#[derive(Clone, Debug)]
pub(super) struct Edges {
    /// Lower edges of the bins 1, 2, …
    inner: Vec<f32>,
    min: f32,
    max: f32,
    bins_per_unit: f32,
}

impl Edges {
    pub(super) fn new(bins: Bins) -> Self {
        let width = (bins.max - bins.min) / bins.count as f32;
        Self {
            inner: (1..bins.count).map(|bin| bins.min + width * bin as f32).collect(),
            min: bins.min,
            max: bins.max,
            bins_per_unit: bins.count as f32 / (bins.max - bins.min),
        }
    }

    pub(super) fn bins(&self) -> usize {
        self.inner.len() + 1
    }

    /// Returns the bin of a value clipped to the range. Bins are half-open, the last one is closed. NaN
    /// belongs to the last bin.
    pub(super) fn bin(&self, value: f32) -> usize {
        let last = self.inner.len();
        if value.is_nan() {
            return last;
        }
        let value = value.clamp(self.min, self.max);
        let mut bin = (((value - self.min) * self.bins_per_unit) as usize).min(last);
        // The estimate is off by at most one, next to an edge.
        while bin > 0 && value < self.inner[bin - 1] {
            bin -= 1;
        }
        while bin < last && value >= self.inner[bin] {
            bin += 1;
        }
        bin
    }
}

/// Returns the logarithms of the smoothed probabilities of the bins with these counts.
pub(super) fn log_probabilities(counts: &[u32]) -> Vec<f64> {
    let total: f64 = counts.iter().map(|&count| f64::from(count)).sum();
    let smoothed = total + HISTOGRAM_PSEUDOCOUNT * counts.len() as f64;
    counts.iter().map(|&count| math::ln((f64::from(count) + HISTOGRAM_PSEUDOCOUNT) / smoothed)).collect()
}

/// Returns the logarithm of the smoothed probability of an outcome that was found in `count` of `total`
/// rollouts.
pub(super) fn log_event_probability(count: u32, total: usize) -> f64 {
    math::ln((f64::from(count) + EVENT_PSEUDOCOUNT) / (total as f64 + 2.0 * EVENT_PSEUDOCOUNT))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_clipped_and_nan_is_in_the_last_bin() {
        let edges = Edges::new(Bins { min: -1.0, max: 1.0, count: 4 });
        for (value, bin) in [(-9.0, 0), (-0.5, 1), (0.0, 2), (0.499, 2), (0.5, 3), (1.0, 3), (f32::NAN, 3)] {
            assert_eq!(edges.bin(value), bin, "{value}");
        }
    }

    #[test]
    fn every_edge_belongs_to_the_upper_bin() {
        #[expect(clippy::approx_constant, reason = "the challenge's bound is 3.14, not pi")]
        let ranges = [(-12.0, 12.0, 11), (-0.628, 0.628, 11), (-3.14, 3.14, 11), (-31.5, 31.5, 10)];
        for (min, max, count) in ranges {
            let edges = Edges::new(Bins { min, max, count });
            for (i, &edge) in edges.inner.iter().enumerate() {
                assert_eq!((edges.bin(edge.next_down()), edges.bin(edge)), (i, i + 1), "{edge}");
            }
        }
    }

    #[test]
    fn probabilities_are_smoothed() {
        let found = log_probabilities(&[3, 0]);
        assert!((found[0] - (3.1f64 / 3.2).ln()).abs() < 1e-15);
        assert!((found[1] - (0.1f64 / 3.2).ln()).abs() < 1e-15);
        assert!((log_event_probability(0, 32) - (0.001f64 / 32.002).ln()).abs() < 1e-15);
    }
}
