//! Relation vectors of pairs, as attention takes them.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

use super::Neighbors;
use super::host::is_host;

/// The relation vector of every slot of [`Neighbors`], for several layers.
#[derive(Clone, Debug)]
pub struct Relations(pub(super) RelationVectors);

/// Storage of the vectors.
#[derive(Clone, Debug)]
pub(super) enum RelationVectors {
    /// The vectors of slots, [N, K, r].
    Tensor(Box<Tensor<3>>),
    /// In host memory, for layers without gradients.
    Host {
        /// The vectors of slots, [N, K, r], or of edges, [E, r].
        vectors: Arc<TensorData>,
        /// Whether they are those of edges.
        of_edges: bool,
    },
}

impl Relations {
    /// Builds relations from the vectors of slots, [N, K, r].
    pub fn new(rows: Tensor<3>) -> Self {
        if is_host(&rows.device()) {
            return Self::on_host(rows.into_data(), false);
        }
        Self(RelationVectors::Tensor(Box::new(rows)))
    }

    /// Builds relations from the vectors of edges, [E, r]. The values equal those of [`Relations::new`] of
    /// [`Neighbors::relations`].
    pub fn of_edges(neighbors: &Neighbors, edges: Tensor<2>) -> Self {
        if is_host(&edges.device()) {
            return Self::on_host(edges.into_data(), true);
        }
        Self::new(neighbors.relations(edges))
    }

    fn on_host(vectors: TensorData, of_edges: bool) -> Self {
        Self(RelationVectors::Host { vectors: Arc::new(vectors), of_edges })
    }

    /// Returns the vectors of slots as a tensor, [N, K, r].
    pub(super) fn tensor(&self, neighbors: &Neighbors, device: &Device) -> Tensor<3> {
        match &self.0 {
            RelationVectors::Tensor(rows) => rows.as_ref().clone(),
            RelationVectors::Host { vectors, of_edges } => {
                let vectors = vectors.as_ref().clone();
                if *of_edges {
                    neighbors.relations(Tensor::from_data(vectors, device))
                } else {
                    Tensor::from_data(vectors, device)
                }
            }
        }
    }
}
