//! An encoded scene.

use burn::tensor::Tensor;

/// Features of the elements of a scene, and of all pairs.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// `[elements, width]`.
    pub(super) elements: Tensor<2>,
    /// `[elements, elements, width]`.
    pub(super) relations: Tensor<3>,
    /// Added to the scores of elements as keys, `[1, 1, 1, elements]`: closed if absent.
    pub(super) closed: Tensor<4>,
}

impl Encoded {
    /// Returns the features of the first `agents` elements, `[agents, width]`.
    pub(super) fn agents(&self, agents: usize) -> Tensor<2> {
        self.elements.clone().narrow(0, 0, agents)
    }

    /// Returns the relations of the first `agents` elements to the first `others`, `[agents, others, width]`.
    pub(super) fn relations(&self, agents: usize, others: usize) -> Tensor<3> {
        self.relations.clone().narrow(0, 0, agents).narrow(1, 0, others)
    }
}
