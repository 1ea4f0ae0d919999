//! Savitzky–Golay filters: local least-squares polynomials and their derivatives.

/// A filter: window in samples, degree of the polynomial, order of the derivative.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SavitzkyGolay {
    /// Number of samples that each polynomial is fitted to.
    pub window: usize,
    /// Degree of the polynomial, less than the window.
    pub degree: usize,
    /// Order of the derivative that is evaluated; 0 smooths.
    pub derivative: usize,
}

impl SavitzkyGolay {
    /// Computes the weights of the filter for series of `samples` values, which are `interval` seconds
    /// apart. The window shrinks to the number of values.
    ///
    /// In the interior, the polynomial is evaluated at the middle of the window. The middle of a window of
    /// even size is between two samples, and the value belongs to the earlier one. The first and the last
    /// half window have the values of the polynomial of the first and the last whole window (the mode
    /// `interp` of SciPy 1.11).
    ///
    /// The filter returns nothing if there are not more values than the degree.
    pub fn prepare(&self, samples: usize, interval: f64) -> PreparedFilter {
        let window = self.window.min(samples);
        if window <= self.degree {
            return PreparedFilter { weights: Vec::new(), outputs: Vec::new() };
        }
        let half = window / 2;
        let scale = (0..self.derivative).fold(1.0, |scale, _| scale / interval);
        let middle = (window - 1) as f64 / 2.0;
        let edges =
            (0..half).chain(window - half..window).map(|position| self.weights(window, position as f64));
        let mut weights: Vec<Vec<f64>> = [self.weights(window, middle)].into_iter().chain(edges).collect();
        weights.iter_mut().flatten().for_each(|weight| *weight *= scale);
        let output = |k: usize| {
            if k < half {
                (0, 1 + k)
            } else if k >= samples - half {
                (samples - window, 1 + 2 * half + k - samples)
            } else {
                (k - (window - 1) / 2, 0)
            }
        };
        PreparedFilter { weights, outputs: (0..samples).map(output).collect() }
    }

    /// Returns the weight of each sample of a window for the derivative at `position`, in samples from the
    /// start of the window.
    ///
    /// The polynomials that are orthogonal on the samples (Gram) have leading coefficient 1 and follow the
    /// recurrence P(j+1) = (x − m) P(j) − β(j) P(j−1), with the middle m of the window and
    /// β(j) = j² (w² − j²) / (4 (4 j² − 1)).
    fn weights(&self, window: usize, position: f64) -> Vec<f64> {
        let w = window as f64;
        let middle = (w - 1.0) / 2.0;
        let samples: Vec<f64> = (0..window).map(|i| i as f64 - middle).collect();
        let mut weights = vec![0.0; window];
        // Values of two successive polynomials at the samples, and their derivatives at the position.
        let (mut before, mut here) = (vec![0.0; window], vec![1.0; window]);
        let mut derivatives_before = vec![0.0; self.derivative + 1];
        let mut derivatives = vec![0.0; self.derivative + 1];
        derivatives[0] = 1.0;
        let mut norm = w;
        let x = position - middle;
        for j in 0..=self.degree {
            let factor = derivatives[self.derivative] / norm;
            weights.iter_mut().zip(&here).for_each(|(weight, value)| *weight += factor * value);
            let beta = if j == 0 { 0.0 } else { recurrence_factor(j as f64, w) };
            let next = samples.iter().zip(here.iter().zip(&before)).map(|(s, (p, q))| s * p - beta * q);
            let next: Vec<f64> = next.collect();
            before = std::mem::replace(&mut here, next);
            let next_derivatives = (0..=self.derivative).map(|m| {
                let lower = if m == 0 { 0.0 } else { m as f64 * derivatives[m - 1] };
                x * derivatives[m] + lower - beta * derivatives_before[m]
            });
            let next_derivatives: Vec<f64> = next_derivatives.collect();
            derivatives_before = std::mem::replace(&mut derivatives, next_derivatives);
            norm *= recurrence_factor(j as f64 + 1.0, w);
        }
        weights
    }
}

/// The weights of a filter for series of one length.
#[derive(Clone, Debug, PartialEq)]
pub struct PreparedFilter {
    /// Weights of a window: around inner samples, and for each sample of the first and the last half
    /// window.
    weights: Vec<Vec<f64>>,
    /// For each output, the first sample of its window and the index of its weights.
    outputs: Vec<(usize, usize)>,
}

impl PreparedFilter {
    /// Filters `values`, which must be as many as the filter is prepared for; missing values count as 0.
    pub fn apply(&self, values: &[f64]) -> Vec<f64> {
        self.outputs.iter().map(|output| self.output(*output, values)).collect()
    }

    /// Returns the last value of [`Self::apply`]; `None` if it returns none.
    pub fn last(&self, values: &[f64]) -> Option<f64> {
        self.outputs.last().map(|output| self.output(*output, values))
    }

    fn output(&self, (start, weights): (usize, usize), values: &[f64]) -> f64 {
        let window = values.get(start..).unwrap_or_default();
        self.weights[weights].iter().zip(window).map(|(weight, value)| weight * value).sum()
    }
}

/// Returns β(j), which is also the ratio of the squared norms of polynomial j and the one before.
fn recurrence_factor(j: f64, window: f64) -> f64 {
    j * j * (window * window - j * j) / (4.0 * (4.0 * j * j - 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: &[f64], b: &[f64]) {
        assert_eq!(a.len(), b.len());
        assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12), "{a:?} is not {b:?}");
    }

    fn filter(window: usize, degree: usize, derivative: usize) -> SavitzkyGolay {
        SavitzkyGolay { window, degree, derivative }
    }

    fn filtered(filter: SavitzkyGolay, values: &[f64]) -> Vec<f64> {
        filter.prepare(values.len(), 0.1).apply(values)
    }

    #[test]
    fn interior_weights_are_those_of_the_literature() {
        let even = [-3.0, 3.0, 7.0, 9.0, 9.0, 7.0, 3.0, -3.0].map(|w| w / 32.0);
        close(&filter(8, 2, 0).weights(8, 3.5), &even);
        let slope: Vec<f64> = (-7..=7).map(|j| f64::from(j) / 280.0).collect();
        close(&filter(15, 2, 1).weights(15, 7.0), &slope);
        close(&filter(5, 2, 1).weights(5, 2.0), &[-0.2, -0.1, 0.0, 0.1, 0.2]);
        close(&filter(5, 3, 2).weights(5, 2.0), &[2.0, -1.0, -2.0, -1.0, 2.0].map(|w| w / 7.0));
    }

    #[test]
    fn polynomials_of_the_degree_pass_unchanged() {
        let cubic = |x: f64| 0.3 * x * x * x - x * x + 2.0 * x - 1.0;
        let values: Vec<f64> = (0..9).map(|i| cubic(f64::from(i) * 0.1)).collect();
        close(&filtered(filter(5, 3, 0), &values), &values);
        let slopes: Vec<f64> = (0..9).map(|i| f64::from(i) * 0.1).map(|x| 1.8 * x - 2.0).collect();
        let second = filtered(filter(5, 3, 2), &values);
        assert!(second.iter().zip(&slopes).all(|(a, b)| (a - b).abs() < 1e-9));
    }

    #[test]
    fn the_value_of_an_even_window_belongs_to_the_earlier_sample() {
        let ramp: Vec<f64> = (0..20).map(f64::from).collect();
        let smooth = filtered(filter(8, 2, 0), &ramp);
        let close_to = |k: usize, value: f64| (smooth[k] - value).abs() < 1e-12;
        assert!(close_to(3, 3.0) && close_to(4, 4.5) && close_to(15, 15.5) && close_to(16, 16.0));
    }

    #[test]
    fn windows_shrink_to_short_inputs() {
        let values = [0.0, 1.0, 4.0, 9.0];
        close(&filtered(filter(15, 2, 0), &values), &values);
        assert!(filtered(filter(5, 3, 2), &values[..3]).is_empty());
    }
}
