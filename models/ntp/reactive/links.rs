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

    /// Replaces the index of every source by its entry in `rows`.
    pub(crate) fn renumber(&mut self, rows: &[u32]) {
        for (index, _) in self.index.iter_mut().zip(&self.open).filter(|(_, open)| **open) {
            *index = rows[*index as usize];
        }
    }

    /// Returns the sources in open slots.
    pub(crate) fn sources(&self) -> impl Iterator<Item = usize> {
        self.index.iter().zip(&self.open).filter(|(_, open)| **open).map(|(&i, _)| i as usize)
    }
}
