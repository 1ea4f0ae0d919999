//! Savitzky–Golay filters with interpolated edges, as SciPy's `savgol_filter` in mode `interp`.

/// Largest degree of the polynomials.
const MAX_DEGREE: usize = 3;

/// A filter that replaces samples by values or derivatives of polynomials fitted to windows around them.
///
/// A window of even length is not centred: it begins one sample closer to the sample than it ends, and its polynomial
/// is evaluated half a step later. The first and last ⌊window/2⌋ samples take the polynomial of the first or last
/// window.
#[derive(Clone, Debug)]
pub(super) struct SavitzkyGolay {
    window: usize,
    /// Weights of the samples of a window around an inner sample.
    inner: Vec<f64>,
    /// Weights of the first window, for each of the first samples.
    first: Vec<Vec<f64>>,
    /// Weights of the last window, for each of the last samples.
    last: Vec<Vec<f64>>,
}

impl SavitzkyGolay {
    /// Prepares a filter with this window (samples), degree (at most 3, below the window) and order of the
    /// derivative (at most the degree), for samples `interval` seconds apart.
    pub(super) fn new(window: usize, degree: usize, derivative: usize, interval: f64) -> Self {
        let half = window / 2;
        let weights = |position: f64| weights(window, degree, derivative, interval, position);
        Self {
            window,
            inner: weights(0.5 * (window - 1) as f64),
            first: (0..half).map(|i| weights(i as f64)).collect(),
            last: (window - half..window).map(|i| weights(i as f64)).collect(),
        }
    }

    /// Returns the filtered samples; there must be at least as many as the window has.
    pub(super) fn apply(&self, samples: &[f64]) -> Vec<f64> {
        let half = self.window / 2;
        let (head, tail) = (&samples[..self.window], &samples[samples.len() - self.window..]);
        let before = if self.window.is_multiple_of(2) { half - 1 } else { half };
        let inner =
            (half..samples.len() - half).map(|i| dot(&self.inner, &samples[i - before..][..self.window]));
        let first = self.first.iter().map(|weights| dot(weights, head));
        first.chain(inner).chain(self.last.iter().map(|weights| dot(weights, tail))).collect()
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Returns the weights of the samples of a window whose sum is the derivative at `position` (in samples from the first
/// one) of the polynomial fitted to them.
fn weights(window: usize, degree: usize, derivative: usize, interval: f64, position: f64) -> Vec<f64> {
    let middle = 0.5 * (window - 1) as f64;
    let offset = |sample: usize| sample as f64 - middle;
    let mut moments = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    for sample in 0..window {
        let powers = powers(offset(sample));
        for (row, moments) in moments.iter_mut().enumerate().take(degree + 1) {
            for (column, moment) in moments.iter_mut().enumerate().take(degree + 1) {
                *moment += powers[row] * powers[column];
            }
        }
    }
    let basis = solve(moments, basis_derivatives(position - middle, derivative), degree + 1);
    let scale = (0..derivative).map(|_| interval).product::<f64>();
    (0..window).map(|sample| dot(&basis, &powers(offset(sample))) / scale).collect()
}

/// Returns 1, x, x², x³.
fn powers(x: f64) -> [f64; MAX_DEGREE + 1] {
    [1.0, x, x * x, x * x * x]
}

/// Returns the derivatives of 1, x, x², x³ of an order up to 2.
fn basis_derivatives(x: f64, order: usize) -> [f64; MAX_DEGREE + 1] {
    match order {
        0 => powers(x),
        1 => [0.0, 1.0, 2.0 * x, 3.0 * x * x],
        _ => [0.0, 0.0, 2.0, 6.0 * x],
    }
}

/// Solves a symmetric positive definite system of the first `size` unknowns by elimination; the others are 0.
fn solve(
    mut matrix: [[f64; MAX_DEGREE + 1]; MAX_DEGREE + 1],
    mut right: [f64; MAX_DEGREE + 1],
    size: usize,
) -> [f64; MAX_DEGREE + 1] {
    for pivot in 0..size {
        for row in pivot + 1..size {
            let factor = matrix[row][pivot] / matrix[pivot][pivot];
            for column in pivot..size {
                matrix[row][column] -= factor * matrix[pivot][column];
            }
            right[row] -= factor * right[pivot];
        }
    }
    let mut solution = [0.0; MAX_DEGREE + 1];
    for row in (0..size).rev() {
        let known: f64 = (row + 1..size).map(|column| matrix[row][column] * solution[column]).sum();
        solution[row] = (right[row] - known) / matrix[row][row];
    }
    solution
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_are_those_of_the_literature() {
        let close = |found: &[f64], expected: &[f64]| {
            assert_eq!(found.len(), expected.len());
            assert!(found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-9), "{found:?}");
        };
        let even = [-3.0, 3.0, 7.0, 9.0, 9.0, 7.0, 3.0, -3.0].map(|weight| weight / 32.0);
        close(&SavitzkyGolay::new(8, 2, 0, 0.1).inner, &even);
        close(&SavitzkyGolay::new(5, 2, 1, 0.1).inner, &[-2.0, -1.0, 0.0, 1.0, 2.0]);
        let second = [2.0, -1.0, -2.0, -1.0, 2.0].map(|weight| weight / 0.07);
        close(&SavitzkyGolay::new(5, 3, 2, 0.1).inner, &second);
    }

    #[test]
    fn polynomials_are_reproduced_up_to_the_edges() {
        let samples: Vec<f64> = (0..20).map(|i| 3.0 - 0.1 * f64::from(i) + 0.02 * f64::from(i * i)).collect();
        let filtered = SavitzkyGolay::new(7, 2, 0, 1.0).apply(&samples);
        assert!(filtered.iter().zip(&samples).all(|(a, b)| (a - b).abs() < 1e-9));
        let slopes = SavitzkyGolay::new(7, 2, 1, 0.5).apply(&samples);
        assert!((slopes[0] + 0.2).abs() < 1e-9 && (slopes[19] - 2.0 * (-0.1 + 0.04 * 19.0)).abs() < 1e-9);
    }
}
