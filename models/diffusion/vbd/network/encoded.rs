//! An encoded scene.

use burn::tensor::Tensor;

use super::surroundings::Surroundings;

/// Features of the elements of a scene, and their surroundings.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// `[elements, width]`.
    pub(super) elements: Tensor<2>,
    /// The elements that each element attends to.
    pub(super) surroundings: Surroundings,
}

impl Encoded {
    /// Returns the features of the first `agents` elements, `[agents, width]`.
    pub(super) fn agents(&self, agents: usize) -> Tensor<2> {
        self.elements.clone().narrow(0, 0, agents)
    }
}
