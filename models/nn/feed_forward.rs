//! Feed-forward half of an attention layer.

use serde::{Deserialize, Serialize};

use super::{Activation, Initializer, Perceptron, PerceptronKind};

/// ReLU, with dropout after it.
const RELU: PerceptronKind =
    PerceptronKind { activation: Activation::Relu, linears: &["0", "3"], norms: &[] };
/// SwiGLU, as TrajTok names it.
const SWIGLU: PerceptronKind =
    PerceptronKind { activation: Activation::SwiGlu, linears: &["w12", "w3"], norms: &[] };

/// Type and width of a feed-forward network.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum FeedForwardConfig {
    /// Linear to this hidden width, ReLU, linear (SMART, CATK: four times the width of the layer).
    Relu(usize),
    /// SwiGLU with this hidden width (TrajTok: see [`FeedForwardConfig::swiglu`]).
    SwiGlu(usize),
}

impl FeedForwardConfig {
    /// Returns a SwiGLU network with about as many weights as a ReLU network of width `hidden`: two
    /// thirds of that width, rounded up to a multiple of 8.
    pub fn swiglu(hidden: usize) -> Self {
        Self::SwiGlu((hidden * 2 / 3).next_multiple_of(8))
    }

    /// Builds the network for features of this width.
    pub(super) fn init(self, width: usize, init: &mut Initializer) -> Perceptron {
        match self {
            Self::Relu(hidden) => RELU.init(&[width, hidden, width], init),
            Self::SwiGlu(hidden) => SWIGLU.init(&[width, hidden, width], init),
        }
    }

    /// Returns whether dropout applies to hidden features: not with SwiGLU, as published.
    pub(super) fn has_dropout(self) -> bool {
        matches!(self, Self::Relu(_))
    }
}
