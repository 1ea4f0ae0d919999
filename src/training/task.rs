//! What a network has to offer to be trained here.

use burn::module::Module;
use burn::tensor::Tensor;

use super::{Stream, Sums};

/// What is learned from, by number. Reading is done by several threads, in any order and again in every epoch: only what is being
/// worked on is in memory.
pub trait Source: Sync {
    /// One example as it is stored, such as a scenario.
    type Example: Send;

    /// How many there are.
    fn len(&self) -> usize;

    /// Whether there are none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The name of an example. It decides about its random numbers and whether it is held out; examples of one name are of one side.
    fn id(&self, number: usize) -> &str;

    /// Reads an example.
    ///
    /// # Errors
    /// In words, with the place: the training ends.
    fn read(&self, number: usize) -> Result<Self::Example, String>;

    /// A digest of everything that can be read: a training is resumed only where it is the same.
    fn digest(&self) -> String;

    /// The numbers of the examples by the part that they belong to, each part with the number of times that each of its examples is
    /// seen in an epoch on average.
    fn parts(&self) -> Vec<(Vec<usize>, f64)> {
        vec![((0..self.len()).collect(), 1.0)]
    }
}

/// How an example is looked at.
#[derive(Debug)]
pub enum View<'a> {
    /// To learn from it: varied by what is drawn from this stream, which is named by the seed, the place in the order and the example's name.
    Varied(&'a mut Stream),
    /// To judge by it: as it is.
    Plain,
}

/// A network and how it is judged.
///
/// Every number here must be a function of the arguments alone, whatever thread it runs on.
pub trait Task: Sync {
    /// What examples are.
    type Example: Send;
    /// What is left of an example when it is prepared for the network.
    type Sample: Send + Sync;
    /// The network. What requires gradients is trained, all as `f32`.
    type Model: Module;

    /// The untrained network, on a device with autodiff. The same seed gives the same network: where parameters are drawn by burn, whose
    /// random numbers are shared by all threads, see [`draw_parameters`](super::draw_parameters).
    fn init(&self, seed: u64) -> Self::Model;

    /// Makes a sample of an example; `None` where there is nothing to learn from it.
    fn prepare(&self, example: &Self::Example, view: View<'_>) -> Option<Self::Sample>;

    /// Runs the network on samples and judges it. The stream is named by seed and step (and by the place in the batch): what dropout, say,
    /// is drawn from. While validating there is none, and the model has no autodiff.
    fn loss(&self, model: &Self::Model, samples: &[Self::Sample], stream: Option<&mut Stream>) -> Output;

    /// What is judged while validating, beside the loss: by default the same.
    fn validate(&self, model: &Self::Model, samples: &[Self::Sample]) -> Output {
        self.loss(model, samples, None)
    }

    /// The file from which a simulator reads the trained network; `about` tells how it was made and is kept in it. By default there is
    /// none, and the parameters are written by name.
    fn file(&self, _model: &Self::Model, _about: &serde_json::Value) -> Option<Vec<u8>> {
        None
    }

    /// What decides about the outcome besides the settings of the learner: a training is resumed only where it is the same. Names and
    /// values, as JSON.
    fn describe(&self) -> serde_json::Value {
        serde_json::Value::Null
    }
}

/// What came out of one run of the network.
#[derive(Debug)]
pub struct Output {
    /// The loss, summed over items (`[1]`): what is minimised is its sum over a batch divided by the items of the batch.
    pub loss: Tensor<1>,
    /// How many items were summed, or the sum of their weights.
    pub items: f64,
    /// What else is worth knowing.
    pub metrics: Sums,
}
