//! The smallest of many values.

/// The `k` smallest of the offered values; equal values are kept in the order of offering.
#[derive(Debug)]
pub struct Nearest {
    k: usize,
    found: Vec<(f64, usize)>,
}

impl Nearest {
    /// Builds an empty list that keeps at most `k`.
    pub fn new(k: usize) -> Self {
        Self { k, found: Vec::with_capacity(k + 1) }
    }

    /// Removes all values.
    pub fn clear(&mut self) {
        self.found.clear();
    }

    /// Offers an index with its value. Values that differ by less than a millionth count as equal, so
    /// that rounding does not decide between places that are equally far by symmetry.
    pub fn offer(&mut self, value: f64, index: usize) {
        let value = value * 1e6;
        let full = self.found.len() == self.k;
        let worst = self.found.last().map_or(f64::NEG_INFINITY, |worst| worst.0);
        // Rounding, which is slow, takes at most a half off.
        if full && !(value - 0.5 < worst) {
            return;
        }
        let value = value.round();
        if full {
            if !(value < worst) {
                return;
            }
            self.found.pop();
        }
        let at = self.found.partition_point(|f| f.0 <= value);
        self.found.insert(at, (value, index));
    }

    /// Returns the largest of the kept values; `None` while another one would be kept in any case.
    pub fn worst(&self) -> Option<f64> {
        self.found.last().filter(|_| self.found.len() == self.k).map(|worst| worst.0 / 1e6)
    }

    /// Returns the kept indices, smallest value first.
    pub fn found(&self) -> impl Iterator<Item = usize> {
        self.found.iter().map(|f| f.1)
    }
}

/// Returns a value, at least 0, in whole millionths. [`Nearest`] counts values as equal if these are.
pub fn millionths(value: f64) -> u64 {
    let value = value * 1e6;
    let whole = value as u64;
    whole + u64::from(value - whole as f64 >= 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_are_kept_in_the_order_of_offering() {
        for k in [0, 1, 3, 40] {
            let mut nearest = Nearest::new(k);
            // Many values are equal once they are rounded; some are just beyond a half.
            let values: Vec<f64> = (0..200u32).map(|i| f64::from((i * 7919) % 37) * 0.49e-6).collect();
            let mut wanted: Vec<(f64, usize)> =
                values.iter().enumerate().map(|(i, v)| ((v * 1e6).round(), i)).collect();
            wanted.sort_by(|a, b| a.0.total_cmp(&b.0));
            values.iter().enumerate().for_each(|(i, v)| nearest.offer(*v, i));
            let wanted: Vec<usize> = wanted.into_iter().take(k).map(|(_, i)| i).collect();
            assert_eq!(nearest.found().collect::<Vec<_>>(), wanted);
        }
    }

    #[test]
    fn millionths_are_rounded() {
        for value in [0.0, 0.49e-6, 0.5e-6, 2.5e-6, 1.4999e-6, 123.456_789_5, 9.0e8] {
            assert_eq!(millionths(value) as f64, (value * 1e6).round(), "{value}");
        }
    }
}
