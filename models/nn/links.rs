//! Attention links of nodes, in rows of equal length, with a relation per link.

use burn::nn::Linear;
use burn::tensor::{Device, Tensor, TensorData};

use super::{Neighbors, Noise, RelationalAttention, Relations, Rows};

/// Neighbours of `n` nodes, with `k` slots each.
#[derive(Clone, Debug, Default)]
pub struct Links {
    /// Indices of sources, `[n, k]`; 0 in closed slots.
    pub index: Vec<u32>,
    /// Whether a slot has a neighbour, `[n, k]`.
    pub open: Vec<bool>,
    /// Relation of the source to the node, `[n, k, features]`; 0 in closed slots.
    pub relation: Vec<f32>,
}

impl Links {
    /// Reserves memory for this many slots, with this many numbers per relation.
    pub fn with_capacity(slots: usize, features: usize) -> Self {
        Self {
            index: Vec::with_capacity(slots),
            open: Vec::with_capacity(slots),
            relation: Vec::with_capacity(slots * features),
        }
    }

    /// Appends a node with its sources, at most `k`, nearest first.
    pub fn push(
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
    pub fn renumber(&mut self, rows: &[u32]) {
        for (index, _) in self.index.iter_mut().zip(&self.open).filter(|(_, open)| **open) {
            *index = rows[*index as usize];
        }
    }

    /// Returns the sources in open slots.
    pub fn sources(&self) -> impl Iterator<Item = usize> {
        self.index.iter().zip(&self.open).filter(|(_, open)| **open).map(|(&i, _)| i as usize)
    }

    /// Appends the nodes of another scene. `row` returns the row of each of its sources.
    pub fn append(&mut self, links: &Self, row: impl Fn(usize) -> usize) {
        let moved = links.index.iter().zip(&links.open);
        self.index.extend(moved.map(|(&i, &open)| if open { row(i as usize) as u32 } else { 0 }));
        self.open.extend_from_slice(&links.open);
        self.relation.extend_from_slice(&links.relation);
    }

    /// Returns the links of some nodes, in this order, with `k` slots per node and `features` numbers per
    /// relation.
    pub fn of_nodes(&self, nodes: &[usize], k: usize, features: usize) -> Self {
        let mut chosen = Self::with_capacity(nodes.len() * k, features);
        for &node in nodes {
            let (first, end) = (node * k, (node + 1) * k);
            chosen.index.extend_from_slice(&self.index[first..end]);
            chosen.open.extend_from_slice(&self.open[first..end]);
            chosen.relation.extend_from_slice(&self.relation[first * features..end * features]);
        }
        chosen
    }

    /// Converts links with `k` slots per node and `features` numbers per relation to tensors.
    pub fn tensors(self, k: usize, features: usize, device: &Device) -> LinkTensors {
        let (nodes, slots) = (self.index.len() / k, self.index.len());
        let relation = TensorData::new(self.relation, [slots, features]);
        LinkTensors {
            neighbors: Neighbors::from_slots(nodes, k, &self.index, &self.open, device),
            relation: Tensor::from_data(relation, device),
        }
    }
}

/// Neighbours as tensors.
#[derive(Clone, Debug)]
pub struct LinkTensors {
    /// Neighbours of `n` nodes, with `k` slots each.
    pub neighbors: Neighbors,
    /// `[n * k, features]`: relation of the source of each slot to the node.
    pub relation: Tensor<2>,
}

impl LinkTensors {
    /// Embeds the relations by this layer and ReLU, `[n, k, relation]`. The following linear layer is part of
    /// the attention layer.
    pub fn embed(&self, linear: &Linear) -> Relations {
        let (n, k) = (self.neighbors.destinations(), self.neighbors.slots());
        let embedded = Rows::linear(linear, self.relation.clone()).relu().done();
        let width = embedded.dims()[1];
        Relations::new(embedded.reshape([n, k, width]))
    }

    /// Applies an attention layer to nodes, `[n, width]`, which attend to one another.
    pub fn attend(&self, layer: &RelationalAttention, nodes: Tensor<2>, relation: &Relations) -> Tensor<2> {
        let sources = layer.sources(nodes.clone());
        self.attend_to(layer, nodes, sources, relation)
    }

    /// Applies an attention layer to nodes, `[n, width]`, with sources from [`RelationalAttention::sources`].
    pub fn attend_to(
        &self,
        layer: &RelationalAttention,
        nodes: Tensor<2>,
        sources: Tensor<2>,
        relation: &Relations,
    ) -> Tensor<2> {
        layer.forward(nodes, sources, &self.neighbors, relation, &mut Noise::none())
    }
}
