//! Shared part of the trainings of the network: its vocabularies, the loss, files and simulators.

use std::collections::BTreeMap;

use burn::tensor::{Device, Int, Tensor};
use reactsim_nn::Noise;
use reactsim_nn::perception::Class;
use reactsim_nn::training::Output;
use reactsim_rollout::Controller;

use super::super::super::entries::SMART;
use super::super::super::policy_loss::{Choice, in_batch, policy_loss};
use super::super::super::smoothing::{Smoothing, TargetDistributions};
use super::super::super::token_loss::{Target, first_rows, token_loss};
use super::super::super::tokens::{MapVocabulary, Vocabulary};
use super::super::{
    Batch, Scene, Smart, SmartParameters, SmartPolicy, SmartSimulator, TokenShapes, TokenTables, token_shapes,
};
use super::Sample;

/// Reason why the network reads every sample.
const READ: &str = "samples and networks are made for these vocabularies and this configuration";

/// Vocabularies, device and target distributions of a training.
pub(super) struct TokenLearning {
    pub(super) vocabulary: Vocabulary,
    pub(super) map_vocabulary: MapVocabulary,
    /// Device without autodiff.
    pub(super) device: Device,
    shapes: TokenShapes,
    /// Target distributions on the device without autodiff.
    distributions: TargetDistributions,
    /// The same on the device with autodiff.
    learning_distributions: TargetDistributions,
}

impl TokenLearning {
    /// Prepares a training on this device, which must be one without autodiff.
    pub(super) fn new(
        vocabulary: Vocabulary,
        map_vocabulary: MapVocabulary,
        smoothing: &Smoothing,
        device: &Device,
    ) -> Self {
        let distributions = |device: &Device| TargetDistributions::of(&vocabulary, smoothing, device);
        Self {
            shapes: token_shapes(&vocabulary, &map_vocabulary),
            distributions: distributions(device),
            learning_distributions: distributions(&device.clone().autodiff()),
            device: device.clone(),
            vocabulary,
            map_vocabulary,
        }
    }

    /// Returns the embedding vectors of all tokens by a network without autodiff.
    pub(super) fn tables(&self, network: &Smart) -> TokenTables {
        network.tables(&self.shapes, &self.device).expect(READ)
    }

    /// Returns the loss of a network with autodiff.
    pub(super) fn loss(&self, network: &Smart, samples: &[Sample], noise: &mut Noise) -> Output {
        let device = self.device.clone().autodiff();
        self.loss_on(network, samples, &self.learning_distributions, &device, noise)
    }

    /// Returns the loss of a network without autodiff, and without noise.
    pub(super) fn plain_loss(&self, network: &Smart, samples: &[Sample]) -> Output {
        self.loss_on(network, samples, &self.distributions, &self.device, &mut Noise::none())
    }

    fn loss_on(
        &self,
        network: &Smart,
        samples: &[Sample],
        distributions: &TargetDistributions,
        device: &Device,
        noise: &mut Noise,
    ) -> Output {
        let scores = self.scores(network, samples.iter().map(|s| &s.scene), device, noise);
        let targets: Vec<Target> = samples
            .iter()
            .zip(first_rows(samples.iter().map(|sample| nodes(&sample.scene))))
            .flat_map(|(sample, first)| sample.targets.iter().map(move |target| target.in_batch(first)))
            .collect();
        token_loss(&targets, distributions, device, |class, rows| self.of_class(&scores, class, rows))
    }

    /// Returns the loss of a network with autodiff by a policy gradient, held near a reference network
    /// without autodiff: the tokens that were drawn in each scene, and how agents fared.
    pub(super) fn policy_loss(
        &self,
        network: &Smart,
        reference: &Smart,
        scenes: &[&Scene],
        choices: &[&Vec<Choice>],
        anchor: f64,
    ) -> Output {
        let device = self.device.clone().autodiff();
        let noise = &mut Noise::none();
        let scores = self.scores(network, scenes.iter().copied(), &device, noise);
        let fixed = self.scores(reference, scenes.iter().copied(), &self.device, noise);
        let all = in_batch(choices.iter().copied(), first_rows(scenes.iter().map(|scene| nodes(scene))));
        let current = |class, rows| self.of_class(&scores, class, rows);
        policy_loss(&all, anchor, &device, current, |class, rows| self.of_class(&fixed, class, rows))
    }

    /// Returns the scores of rows of nodes for the tokens of a class, [rows, tokens of the class].
    fn of_class(&self, scores: &Tensor<2>, class: Class, rows: Tensor<1, Int>) -> Tensor<2> {
        scores.clone().select(0, rows).narrow(1, 0, self.vocabulary.tokens(class))
    }

    /// Returns the scores of all nodes of scenes, [nodes, tokens].
    fn scores<'s>(
        &self,
        network: &Smart,
        scenes: impl Iterator<Item = &'s Scene>,
        device: &Device,
        noise: &mut Noise,
    ) -> Tensor<2> {
        let batch = Batch::new(network.config(), scenes, noise).expect(READ);
        let tables = network.tables(&self.shapes, device).expect(READ);
        network.forward(&tables, &batch, noise)
    }

    /// Returns a network with its vocabularies. The error is a message.
    fn policy(&self, network: &Smart) -> Result<SmartPolicy, String> {
        let (vocabulary, map_vocabulary) = (self.vocabulary.clone(), self.map_vocabulary.clone());
        SmartPolicy::new(network.clone(), vocabulary, map_vocabulary, &self.device).map_err(|e| e.to_string())
    }

    /// Returns the file of a network with these metadata.
    pub(super) fn file(&self, network: &Smart, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.policy(network).ok()?.write(metadata).ok()
    }

    /// Returns the simulator that executes the tokens of a network as they are. The error is a message.
    pub(super) fn controller(&self, network: &Smart) -> Result<Controller, String> {
        let SmartParameters { map_radius, .. } = SMART.parameters().map_err(|e| e.to_string())?;
        self.controller_within(network, map_radius)
    }

    /// As [`Self::controller`], with a map of this radius in metres.
    pub(super) fn controller_within(&self, network: &Smart, map_radius: f64) -> Result<Controller, String> {
        let parameters: SmartParameters = SMART.parameters().map_err(|e| e.to_string())?;
        let parameters = SmartParameters { map_radius, ..parameters };
        Ok(Controller::Fair(Box::new(SmartSimulator::new("smart", self.policy(network)?, parameters))))
    }
}

/// Returns the number of nodes of a scene.
fn nodes(scene: &Scene) -> usize {
    scene.agents.len() * scene.steps.len()
}
