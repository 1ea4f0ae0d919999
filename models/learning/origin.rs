//! The network that a training begins with.

use burn::tensor::Device;
use reactsim_nn::Initializer;

/// Network that a training begins with.
#[derive(Clone, Debug)]
pub enum Origin<M> {
    /// One with random weights.
    Random,
    /// One that was trained before, on a device with autodiff, and the digest of its file.
    Parent(M, String),
}

impl<M: Clone> Origin<M> {
    /// Returns the network, on this device with autodiff: a copy of the parent, or a new one by `init`. The
    /// device must be one without autodiff.
    pub fn network(&self, seed: u64, device: &Device, init: impl FnOnce(&mut Initializer) -> M) -> M {
        match self {
            Self::Random => init(&mut Initializer::new(seed, &device.clone().autodiff())),
            Self::Parent(network, _) => network.clone(),
        }
    }

    /// Adds the digest of the file to the description of a training, if there is one.
    pub fn describe(&self, mut all: serde_json::Value) -> serde_json::Value {
        if let Self::Parent(_, digest) = self {
            all["from"] = digest.as_str().into();
        }
        all
    }
}
