//! Pairs as attention wants them.

use burn::tensor::{Device, Tensor};

use reactsim::models::nn::{FourierEmbedding, Neighbors, Relations, normalize};

use super::Edges;

/// Neighbours with the vectors of their relations, embedded and normalised once for all layers.
#[derive(Clone, Debug)]
pub struct Links {
    /// Who attends to whom.
    pub neighbors: Neighbors,
    /// What is known of each pair.
    pub relations: Relations,
}

impl Links {
    /// From pairs whose targets are among so many nodes. Only real pairs are embedded.
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
