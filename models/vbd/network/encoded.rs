//! An encoded scene.

use burn::tensor::Tensor;

use super::surroundings::Surroundings;

/// Features of the elements of a scene, and what they see.
#[derive(Clone, Debug)]
pub struct Encoded {
    /// `[elements, width]`.
    pub(super) elements: Tensor<2>,
    /// What each element sees.
    pub(super) surroundings: Surroundings,
}

impl Encoded {
    /// Returns the features of the first `agents` elements, `[agents, width]`.
    pub(super) fn agents(&self, agents: usize) -> Tensor<2> {
        self.elements.clone().narrow(0, 0, agents)
    }
}
