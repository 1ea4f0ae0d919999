//! The network that a training begins with.

use burn::tensor::Device;

use crate::Initializer;

/// Network that a training begins with, and the device of the training.
#[derive(Clone, Debug)]
pub struct Origin<M> {
    /// Device without autodiff.
    device: Device,
    /// Network that was trained before, on the device with autodiff, and the digest of its file.
    parent: Option<(M, String)>,
}

impl<M: Clone> Origin<M> {
    /// Begins on this device, which must be one without autodiff, with a network that was trained before, on the
    /// same device with autodiff, and the digest of its file; without these with random weights.
    pub fn new(device: &Device, parent: Option<(M, String)>) -> Self {
        Self { device: device.clone(), parent }
    }

    /// Returns the device: with autodiff in training, without it in validation.
    pub fn device(&self, training: bool) -> Device {
        if training { self.device.clone().autodiff() } else { self.device.clone() }
    }

    /// Returns the network, on the device with autodiff: a copy of the parent, or a new one by `init`.
    pub fn network(&self, seed: u64, init: impl FnOnce(&mut Initializer) -> M) -> M {
        match &self.parent {
            None => init(&mut Initializer::new(seed, &self.device(true))),
            Some((network, _)) => network.clone(),
        }
    }

    /// Returns whether the network was trained before.
    pub fn is_trained(&self) -> bool {
        self.parent.is_some()
    }

    /// Adds the digest of the parent's file to the description of a training, if there is one.
    pub fn describe(&self, mut all: serde_json::Value) -> serde_json::Value {
        if let Some((_, digest)) = &self.parent {
            all["from"] = digest.as_str().into();
        }
        all
    }
}
