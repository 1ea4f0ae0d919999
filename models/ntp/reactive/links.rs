//! Attention links of nodes, in rows of equal length.

/// Neighbours of `n` nodes, with `k` slots each.
#[derive(Clone, Debug, Default)]
pub(crate) struct Links {
    /// Indices of sources, `[n, k]`; 0 in closed slots.
    pub index: Vec<u32>,
    /// Whether a slot has a neighbour, `[n, k]`.
    pub open: Vec<bool>,
    /// Relation of the source to the node, `[n, k, features]`; 0 in closed slots.
    pub relation: Vec<f32>,
}

impl Links {
    /// Appends a node with its sources, at most `k`, nearest first.
    pub(crate) fn push(
        &mut self,
        k: usize,
        features: usize,
        sources: &[usize],
        mut relate: impl FnMut(usize, &mut [f32]),
    ) {
        let (at, open) = (self.index.len(), sources.len().min(k));
        self.index.resize(at + k, 0);
        self.open.resize(at + k, false);
        self.relation.resize((at + k) * features, 0.0);
        for (slot, &source) in sources[..open].iter().enumerate() {
            self.index[at + slot] = source as u32;
            self.open[at + slot] = true;
            relate(source, &mut self.relation[(at + slot) * features..][..features]);
        }
    }

    /// Returns the sources in open slots.
    pub(crate) fn sources(&self) -> impl Iterator<Item = usize> {
        self.index.iter().zip(&self.open).filter(|(_, open)| **open).map(|(&i, _)| i as usize)
    }
}

/// Writes values to the first features of `out`.
pub(crate) fn put<const N: usize>(out: &mut [f32], values: [f64; N]) {
    for (slot, value) in out.iter_mut().zip(values) {
        *slot = value as f32;
    }
}

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
