//! The smallest of many values.

/// The `k` smallest of the offered values; equal values are kept in the order of offering.
#[derive(Debug)]
pub(crate) struct Nearest {
    k: usize,
    found: Vec<(f64, usize)>,
}

impl Nearest {
    /// Builds an empty list that keeps at most `k`.
    pub(crate) fn new(k: usize) -> Self {
        Self { k, found: Vec::with_capacity(k + 1) }
    }

    /// Removes all values.
    pub(crate) fn clear(&mut self) {
        self.found.clear();
    }

    /// Offers an index with its value. Values that differ by less than a millionth count as equal, so
    /// that rounding does not decide between places that are equally far by symmetry.
    pub(crate) fn offer(&mut self, value: f64, index: usize) {
        let value = (value * 1e6).round();
        if self.found.len() == self.k {
            match self.found.last() {
                Some(worst) if value < worst.0 => {}
                _ => return,
            }
            self.found.pop();
        }
        let at = self.found.partition_point(|f| f.0 <= value);
        self.found.insert(at, (value, index));
    }

    /// Returns the kept indices, smallest value first.
    pub(crate) fn found(&self) -> impl Iterator<Item = usize> {
        self.found.iter().map(|f| f.1)
    }
}
