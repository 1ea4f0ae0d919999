//! Relation vectors of pairs, as attention takes them.

use std::sync::Arc;

use burn::tensor::{Device, Tensor, TensorData};

use super::Neighbors;
use super::host::is_host;

/// The relation vector of every slot of [`Neighbors`], for several layers.
#[derive(Clone, Debug)]
pub struct Relations(pub(super) RelationVectors);

/// Where the vectors are.
#[derive(Clone, Debug)]
pub(super) enum RelationVectors {
    /// The vectors of slots, [N, K, r].
    Tensor(Box<Tensor<3>>),
    /// In host memory, for layers without gradients: the vectors of slots, [N, K, r].
    OfSlots(Arc<TensorData>),
    /// The same, of edges, [E, r].
    OfEdges(Arc<TensorData>),
}

impl Relations {
    /// Builds relations from the vectors of slots, [N, K, r].
    pub fn new(rows: Tensor<3>) -> Self {
        if is_host(&rows.device()) {
            return Self(RelationVectors::OfSlots(Arc::new(rows.into_data())));
        }
        Self(RelationVectors::Tensor(Box::new(rows)))
    }

    /// Builds relations from the vectors of edges, [E, r]. The values equal those of [`Relations::new`] of
    /// [`Neighbors::relations`].
    pub fn of_edges(neighbors: &Neighbors, edges: Tensor<2>) -> Self {
        if is_host(&edges.device()) {
            return Self(RelationVectors::OfEdges(Arc::new(edges.into_data())));
        }
        Self::new(neighbors.relations(edges))
    }

    /// Returns the vectors of slots as a tensor, [N, K, r].
    pub(super) fn tensor(&self, neighbors: &Neighbors, device: &Device) -> Tensor<3> {
        match &self.0 {
            RelationVectors::Tensor(rows) => rows.as_ref().clone(),
            RelationVectors::OfSlots(rows) => Tensor::from_data(rows.as_ref().clone(), device),
            RelationVectors::OfEdges(edges) => {
                neighbors.relations(Tensor::from_data(edges.as_ref().clone(), device))
            }
        }
    }
}
