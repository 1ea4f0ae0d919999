//! Histograms with fixed bins.

use serde::Serialize;

/// Number of parts of a bin that are counted separately, so that quartiles need no stored values.
const PARTS_PER_BIN: usize = 20;

/// Bins of equal width. Values outside the range count in the first or the last bin.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Bins {
    /// Lower edge of the first bin, in the unit of the quantity.
    pub start: f64,
    /// Width of each bin.
    pub width: f64,
    /// Number of bins.
    pub count: usize,
}

impl Bins {
    /// Returns the lower edge of bin `i`.
    pub fn edge(&self, i: usize) -> f64 {
        self.start + self.width * i as f64
    }
}

/// Counts of values per bin, detailed enough for the mean and quartiles.
#[derive(Clone, Debug, PartialEq)]
pub struct Histogram {
    bins: Bins,
    /// Count and sum of the values in each part of a bin.
    parts: Vec<(u64, f64)>,
}

impl Histogram {
    /// Creates an empty histogram.
    pub fn new(bins: Bins) -> Self {
        Self { bins, parts: vec![(0, 0.0); bins.count * PARTS_PER_BIN] }
    }

    /// Counts a value. Values that are not finite are ignored.
    pub fn add(&mut self, value: f64) {
        if !value.is_finite() {
            return;
        }
        // A value on an edge belongs to the bin that begins there, however the quotient is rounded.
        let at = ((value - self.bins.start) / self.bins.width * PARTS_PER_BIN as f64 + 1e-9).floor();
        let at = (at.max(0.0) as usize).min(self.parts.len() - 1);
        self.parts[at].0 += 1;
        self.parts[at].1 += value;
    }

    /// Adds the counts of another histogram of the same quantity.
    pub fn merge(&mut self, other: &Self) {
        for (mine, theirs) in self.parts.iter_mut().zip(&other.parts) {
            mine.0 += theirs.0;
            mine.1 += theirs.1;
        }
    }

    /// Returns the bins.
    pub fn bins(&self) -> Bins {
        self.bins
    }

    /// Returns the number of values.
    pub fn n(&self) -> u64 {
        self.parts.iter().map(|part| part.0).sum()
    }

    /// Returns the number of values in each bin.
    pub fn counts(&self) -> Vec<u64> {
        self.parts.chunks(PARTS_PER_BIN).map(|bin| bin.iter().map(|part| part.0).sum()).collect()
    }

    /// Returns the mean of the exact values; `None` without values.
    pub fn mean(&self) -> Option<f64> {
        let n = self.n();
        (n > 0).then(|| self.parts.iter().map(|part| part.1).sum::<f64>() / n as f64)
    }

    /// Returns the value that a share `q` of the values does not exceed, to a twentieth of a bin: the mean
    /// of the values in the same part of a bin, which for counts is the count itself. `None` without
    /// values.
    pub fn quantile(&self, q: f64) -> Option<f64> {
        let wanted = q * self.n() as f64;
        let mut up_to = 0;
        let holds = |part: &&(u64, f64)| {
            up_to += part.0;
            part.0 > 0 && up_to as f64 >= wanted
        };
        self.parts.iter().find(holds).map(|(count, sum)| sum / *count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_are_counted_in_their_bins() {
        let mut h = Histogram::new(Bins { start: -1.0, width: 0.1, count: 20 });
        for value in [-9.0, -0.7, 0.3, 0.35, 9.0, f64::NAN] {
            h.add(value);
        }
        let counts = h.counts();
        assert_eq!((counts[0], counts[3], counts[13], counts[19], h.n()), (1, 1, 2, 1, 5));
        assert_eq!(h.quantile(0.0), Some(-9.0));
    }

    #[test]
    fn quartiles_are_those_of_the_values() {
        let mut h = Histogram::new(Bins { start: 0.0, width: 2.0, count: 10 });
        (0..1000).for_each(|i| h.add(f64::from(i) * 0.02));
        assert!((h.quantile(0.25).unwrap() - 5.0).abs() < 0.1);
        assert!((h.quantile(0.5).unwrap() - 10.0).abs() < 0.1);
        assert!((h.mean().unwrap() - 9.99).abs() < 1e-9);
        assert_eq!(Histogram::new(h.bins()).quantile(0.5), None);
    }
}
