//! Distributions of values.

use reactsim_geometry::math;
use serde::Serialize;

/// Largest number of bins of a histogram.
const MAX_BINS: f64 = 24.0;

/// Distribution of the values of one quantity. Without values there are no mean and no quartiles.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Distribution {
    /// Number of finite values; others are left out.
    pub n: usize,
    /// Mean.
    pub mean: Option<f64>,
    /// Smallest.
    pub min: Option<f64>,
    /// Lower quartile.
    pub lower_quartile: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// Upper quartile.
    pub upper_quartile: Option<f64>,
    /// Largest.
    pub max: Option<f64>,
    /// Number of values in each of the [`Bins`] of the quantity.
    pub histogram: Vec<u64>,
}

impl Distribution {
    /// Computes the distribution of these values. Quartiles are interpolated between the two nearest
    /// values (type 7 of Hyndman and Fan, 1996).
    pub fn of(values: &[f64], bins: &Bins) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let mut histogram = vec![0; bins.count];
        for value in &sorted {
            if let Some(n) = histogram.get_mut(bins.index(*value)) {
                *n += 1;
            }
        }
        let n = sorted.len();
        Self {
            n,
            mean: (n > 0).then(|| sorted.iter().sum::<f64>() / n as f64),
            min: sorted.first().copied(),
            lower_quartile: quantile(&sorted, 0.25),
            median: quantile(&sorted, 0.5),
            upper_quartile: quantile(&sorted, 0.75),
            max: sorted.last().copied(),
            histogram,
        }
    }
}

fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let at = q * sorted.len().checked_sub(1)? as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(below + (above - below) * at.fract())
}

/// Bins of equal width, shared by all distributions of one quantity.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Bins {
    /// Lower edge of the first bin; a multiple of the width.
    pub start: f64,
    /// Width of each bin: 1, 2 or 5 times a power of ten.
    pub width: f64,
    /// Number of bins; 0 without values.
    pub count: usize,
}

impl Bins {
    /// Returns bins that hold all these values, about two dozen at most.
    pub fn of(values: &[f64]) -> Self {
        let finite = values.iter().copied().filter(|v| v.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
        if low > high {
            return Self { start: 0.0, width: 1.0, count: 0 };
        }
        let least = ((high - low) / MAX_BINS).max(low.abs().max(high.abs()) * 1e-9).max(1e-3);
        let power = math::exp10(math::log10(least).floor());
        let widths = [1.0, 2.0, 5.0, 10.0].map(|f| f * power);
        let width = widths.into_iter().find(|w| *w >= least).unwrap_or(widths[3]);
        let first = (low / width).floor();
        let count = ((high / width).floor() - first) as usize + 1;
        Self { start: first * width, width, count }
    }

    /// Returns the index of the bin of a value, which must be among those that the bins were made for.
    fn index(&self, value: f64) -> usize {
        (((value / self.width).floor() - (self.start / self.width).round()).max(0.0)) as usize
    }

    /// Returns the lower edge of bin `i`.
    pub fn edge(&self, i: usize) -> f64 {
        self.start + self.width * i as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_numbers() {
        let values = [4.0, 1.0, f64::NAN, 2.0, 3.0];
        let bins = Bins::of(&values);
        assert_eq!(bins, Bins { start: 1.0, width: 0.2, count: 16 });
        let found = Distribution::of(&values, &bins);
        assert_eq!((found.n, found.mean, found.median), (4, Some(2.5), Some(2.5)));
        assert_eq!((found.lower_quartile, found.upper_quartile), (Some(1.75), Some(3.25)));
        assert_eq!((found.min, found.max), (Some(1.0), Some(4.0)));
        assert_eq!(found.histogram.iter().sum::<u64>(), 4);
    }

    #[test]
    fn no_value_and_one() {
        assert_eq!(Distribution::of(&[], &Bins::of(&[])), Distribution::default());
        let bins = Bins::of(&[-7.0]);
        assert_eq!((bins.count, Distribution::of(&[-7.0], &bins).histogram), (1, vec![1]));
    }

    #[test]
    fn every_value_has_its_bin() {
        for scale in [1e-6, 0.03, 1.0, 777.0] {
            let values: Vec<f64> = (-50..70).map(|i| f64::from(i) * scale * 0.1).collect();
            let bins = Bins::of(&values);
            let found = Distribution::of(&values, &bins);
            assert_eq!(found.histogram.iter().sum::<u64>(), 120, "{bins:?}");
            assert!(bins.count <= 26 && found.histogram[0] > 0, "{bins:?}");
        }
    }
}
