//! Shared part of the trainings that begin with a trained network and let it drive.

use burn::module::Module;
use burn::tensor::Device;
use serde::Serialize;

use super::super::super::smoothing::Smoothing;
use super::super::{Smart, SmartPolicy};
use super::token_learning::TokenLearning;

/// The parent of a fine-tuning, and its tokens.
pub(super) struct FineTuning {
    pub(super) tokens: TokenLearning,
    /// The network to start from, on a device with autodiff.
    parent: Smart,
    /// Digest of its file.
    digest: String,
}

impl FineTuning {
    /// Prepares the fine-tuning of a parent on this device, which must be one without autodiff; the parent
    /// must be on the same with autodiff.
    pub(super) fn new(parent: SmartPolicy, digest: String, smoothing: &Smoothing, device: &Device) -> Self {
        let SmartPolicy { vocabulary, map_vocabulary, network, .. } = parent;
        let tokens = TokenLearning::new(vocabulary, map_vocabulary, smoothing, device);
        Self { tokens, parent: network, digest }
    }

    /// Returns the network to start from. Embeddings of tokens stay as they are.
    pub(super) fn initial(&self) -> Smart {
        self.parent.clone().with_frozen_embeddings()
    }

    /// Returns the parent without autodiff.
    pub(super) fn reference(&self) -> Smart {
        self.parent.valid()
    }

    /// Describes a training by this recipe, for its provenance.
    pub(super) fn describe(&self, recipe: &impl Serialize) -> serde_json::Value {
        serde_json::json!({
            "recipe": recipe,
            "from": self.digest,
            "parameters": self.parent.num_params(),
        })
    }
}
