//! Attention pairs with embedded relations.

use burn::tensor::{Device, Tensor};
use reactsim_nn::{FourierEmbedding, Neighbors, Relations, normalize};

use super::Edges;

/// Neighbours with their relation vectors, embedded and normalized once for all layers.
#[derive(Clone, Debug)]
pub struct Links {
    /// Neighbours of each target.
    pub neighbors: Neighbors,
    /// Relation vectors.
    pub relations: Relations,
}

impl Links {
    /// Builds links from pairs; `targets` is the number of nodes that attend. Only existing pairs are
    /// embedded.
    pub fn new(edges: &Edges, targets: usize, embedding: &FourierEmbedding, device: &Device) -> Self {
        let neighbors = Neighbors::from_edges(targets, &edges.sources, &edges.targets, device);
        if edges.is_empty() {
            let relations = Relations::new(Tensor::zeros([targets, 0, embedding.width()], device));
            return Self { neighbors, relations };
        }
        let vectors = normalize(embedding.forward_host(&edges.relations, None, device));
        let relations = Relations::of_edges(&neighbors, vectors);
        Self { neighbors, relations }
    }
}
