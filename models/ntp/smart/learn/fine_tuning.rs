//! Trainings that begin with a trained network and let it drive.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::Device;
use reactsim_nn::learning::{SimulatorTask, TaskError, TaskSetup, Trainable};
use reactsim_nn::training::{Output, Stream, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use serde::Serialize;
use serde::de::DeserializeOwned;

use super::super::super::smoothing::Smoothing;
use super::super::{Smart, SmartPolicy};
use super::closed_loop::{ClosedLoopSample, Excerpt, sample};
use super::token_learning::TokenLearning;

/// Recipe of a fine-tuning, with its loss.
pub trait ClosedLoopRecipe: Serialize + DeserializeOwned + Send + Sync + Sized + 'static {
    /// Id of the task.
    const ID: &'static str;

    /// Returns what becomes a sample.
    fn excerpt(&self) -> &Excerpt;

    /// Returns the smoothing of labels, by default none.
    fn smoothing(&self) -> Smoothing {
        Smoothing { uniform: 0.0, spatial: 0.0 }
    }

    /// Lets a network drive in samples, and returns its loss. In validation there is no stream, and the network has no
    /// autodiff.
    fn loss(
        tuning: &FineTuning<Self>,
        model: &Smart,
        samples: &[ClosedLoopSample],
        stream: Option<&mut Stream>,
    ) -> Output;
}

/// A fine-tuning task.
pub struct FineTuning<R> {
    pub(super) recipe: R,
    pub(super) tokens: TokenLearning,
    /// The network to start from, on a device with autodiff.
    pub(super) parent: Smart,
    /// Digest of its file.
    digest: String,
}

impl<R: ClosedLoopRecipe> FineTuning<R> {
    /// Builds a task on this device, which must be one without autodiff. The parent must be on the same with
    /// autodiff; `digest` names it.
    pub fn new(recipe: R, parent: SmartPolicy, digest: String, device: &Device) -> Self {
        let SmartPolicy { vocabulary, map_vocabulary, network, .. } = parent;
        let tokens = TokenLearning::new(vocabulary, map_vocabulary, &recipe.smoothing(), device);
        Self { recipe, tokens, parent: network, digest }
    }

    /// Builds the training of an entry of the list of tasks.
    pub(super) fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
        let parent = setup.parent(SmartPolicy::read, |_| true)?;
        let (parent, digest) = parent.ok_or(TaskError::NoWeights { id: R::ID })?;
        Ok(Box::new(Self::new(setup.recipe()?, parent, digest, &setup.device)))
    }
}

impl<R: ClosedLoopRecipe> Task for FineTuning<R> {
    type Example = Scenario;
    type Sample = ClosedLoopSample;
    type Model = Smart;

    /// Embeddings of tokens stay as they are.
    fn init(&self, _seed: u64) -> Smart {
        self.parent.clone().with_frozen_embeddings()
    }

    fn begins_trained(&self) -> bool {
        true
    }

    fn prepare(&self, scenario: &Scenario, stream: Option<&mut Stream>) -> Option<ClosedLoopSample> {
        let TokenLearning { vocabulary, map_vocabulary, .. } = &self.tokens;
        sample(scenario, self.recipe.excerpt(), vocabulary, map_vocabulary, stream)
    }

    fn loss(&self, model: &Smart, samples: &[ClosedLoopSample], stream: Option<&mut Stream>) -> Output {
        R::loss(self, model, samples, stream)
    }

    fn file(&self, model: &Smart, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.tokens.file(model, metadata)
    }

    fn describe(&self) -> serde_json::Value {
        serde_json::json!({
            "recipe": self.recipe,
            "from": self.digest,
            "parameters": self.parent.num_params(),
        })
    }
}

impl<R: ClosedLoopRecipe> SimulatorTask for FineTuning<R> {
    fn controller(&self, network: &Smart) -> Result<Controller, String> {
        self.tokens.controller(network)
    }
}
