//! Distributions of values.

use serde::Serialize;

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
}

impl Distribution {
    /// Computes the distribution of these values. Quartiles are interpolated between the two nearest
    /// values (type 7 of Hyndman and Fan, 1996).
    pub fn of(values: &[f64]) -> Self {
        let mut sorted: Vec<f64> = values.iter().copied().filter(|v| v.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let n = sorted.len();
        Self {
            n,
            mean: (n > 0).then(|| sorted.iter().sum::<f64>() / n as f64),
            min: sorted.first().copied(),
            lower_quartile: quantile(&sorted, 0.25),
            median: quantile(&sorted, 0.5),
            upper_quartile: quantile(&sorted, 0.75),
            max: sorted.last().copied(),
        }
    }
}

fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    let at = q * sorted.len().checked_sub(1)? as f64;
    let (below, above) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
    Some(below + (above - below) * at.fract())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_numbers() {
        let values = [4.0, 1.0, f64::NAN, 2.0, 3.0];
        let found = Distribution::of(&values);
        assert_eq!((found.n, found.mean, found.median), (4, Some(2.5), Some(2.5)));
        assert_eq!((found.lower_quartile, found.upper_quartile), (Some(1.75), Some(3.25)));
        assert_eq!((found.min, found.max), (Some(1.0), Some(4.0)));
    }

    #[test]
    fn without_values_there_are_no_figures() {
        assert_eq!(Distribution::of(&[]), Distribution::default());
    }
}
