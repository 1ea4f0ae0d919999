//! Traits of trainable networks and of their data.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Tensor;

use super::{Observation, Stream, Sums};

/// Training data, read by number. Several threads read, in any order and again in every epoch: only
/// current examples are in memory.
pub trait Source: Sync {
    /// One example as it is stored, such as a scenario.
    type Example: Send;

    /// Returns the number of examples.
    fn len(&self) -> usize;

    /// Returns whether there are no examples.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Returns the name of an example. It determines the example's random numbers.
    fn id(&self, number: usize) -> &str;

    /// Returns the name of what an example was made from, such as a recording. Examples with the same
    /// origin are either all held out or all learned from.
    fn origin(&self, number: usize) -> &str {
        self.id(number)
    }

    /// Reads an example.
    ///
    /// # Errors
    /// A message that names the file and record; it ends the training.
    fn read(&self, number: usize) -> Result<Self::Example, String>;

    /// Returns a digest of all data: a training is resumed only if it is unchanged.
    fn digest(&self) -> String;

    /// Returns the numbers of the examples of each part, and how often each example of the part is seen
    /// per epoch on average.
    fn parts(&self) -> Vec<(Vec<usize>, f64)> {
        vec![((0..self.len()).collect(), 1.0)]
    }
}

/// A network and its loss.
///
/// All results must be functions of the arguments only, independent of the thread.
pub trait Task: Sync {
    /// Example as the source stores it.
    type Example: Send;
    /// Example prepared as input of the network.
    type Sample: Send + Sync;
    /// The network. Parameters that require gradients are trained, all as `f32`; an
    /// [`Average`](super::Average) follows [`Output::averages`].
    type Model: Module;

    /// Returns the network before the first step, on a device with autodiff. The same seed must give the same
    /// network. Burn's random numbers are shared by all threads: redraw parameters with
    /// [`draw_parameters`](super::draw_parameters).
    fn init(&self, seed: u64) -> Self::Model;

    /// Returns whether that network was trained before. If it was, it is validated before the first step, and
    /// is the best network until a later one is better. By default it was not.
    fn begins_trained(&self) -> bool {
        false
    }

    /// Checks that an example is of the kind that the task learns from. By default all are.
    ///
    /// # Errors
    /// A message that names the example; it ends the training.
    fn check(&self, _example: &Self::Example) -> Result<(), String> {
        Ok(())
    }

    /// Prepares a sample of an example; `None` if there is nothing to learn from it. In training the example
    /// is augmented with random numbers of this stream, which is named by the seed, the place in the order
    /// and the example's name. In validation there is no stream, and it stays unchanged.
    fn prepare(&self, example: &Self::Example, stream: Option<&mut Stream>) -> Option<Self::Sample>;

    /// Runs the network on samples and computes the loss. The stream, for dropout for example, is named
    /// by the seed, the step and the part of the batch. In validation there is no stream, and the model
    /// has no autodiff.
    fn loss(&self, model: &Self::Model, samples: &[Self::Sample], stream: Option<&mut Stream>) -> Output;

    /// Computes the loss and metrics of a validation; by default those of [`Task::loss`].
    fn validate(&self, model: &Self::Model, samples: &[Self::Sample]) -> Output {
        self.loss(model, samples, None)
    }

    /// Returns the file from which a simulator reads the trained network, with these metadata, which describe
    /// the training. By default there is none, and the parameters are written as named tensors.
    fn file(&self, _model: &Self::Model, _metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        None
    }

    /// Returns, as JSON, everything other than the learner's settings that determines the result: a
    /// training is resumed only if it is unchanged.
    fn describe(&self) -> serde_json::Value {
        serde_json::Value::Null
    }
}

/// Result of one forward pass.
#[derive(Debug)]
pub struct Output {
    /// Loss summed over items (`[1]`). The training minimises its sum over a batch divided by the number
    /// of items of the batch.
    pub loss: Tensor<1>,
    /// Number of items, or the sum of their weights.
    pub items: f64,
    /// Further metrics.
    pub metrics: Sums,
    /// Values that running averages of the network are to follow. Ignored in validation.
    pub averages: Vec<Observation>,
    /// Reason why there is no result, which ends the training.
    pub failure: Option<String>,
}

impl Output {
    /// Creates the result of a network without running averages.
    pub fn new(loss: Tensor<1>, items: f64, metrics: Sums) -> Self {
        Self { loss, items, metrics, averages: Vec::new(), failure: None }
    }
}
