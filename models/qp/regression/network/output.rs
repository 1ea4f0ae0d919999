//! Output of the network.

use burn::tensor::Tensor;
use reactsim_nn::training::Observation;

/// Output of one layer of the decoder.
#[derive(Clone, Debug)]
pub(crate) struct LayerOutput {
    /// `[scenes, queries]`: unnormalised log-probabilities.
    pub scores: Tensor<2>,
    /// `[scenes * queries, states, 7]`, in the frame of the predicted agent.
    pub modes: Tensor<3>,
}

/// Output of the network.
#[derive(Clone, Debug)]
pub(crate) struct NetworkOutput {
    /// Outputs of the decoder layers; the last one counts.
    pub layers: Vec<LayerOutput>,
    /// `[scenes * agents, states, 7]`: one future of every agent in the input.
    pub dense: Tensor<3>,
    /// Means and variances of the rows of batch norms; empty outside of training.
    pub averages: Vec<Observation>,
}
