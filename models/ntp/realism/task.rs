//! Fine-tuning by realism as a task.

use std::collections::BTreeMap;

use burn::module::Module;
use burn::tensor::{Device, Tensor};
use rand::RngExt;
use reactsim_nn::learning::{SimulatorTask, TaskError, TaskSetup, Trainable, TrainingTask, recipe_values};
use reactsim_nn::training::{Output, Settings, Stream, Sums, Task};
use reactsim_rollout::Controller;
use reactsim_scene::Scenario;

use super::super::learn::DrivenReactive;
use super::super::reactive::Policy;
use super::super::smart::SmartPolicy;
use super::super::smart::learn::DrivenSmart;
use super::advantage::Fines;
use super::group::{Group, Prepared, check};
use super::{Driven, RealismRecipe};

/// Fine-tuning of networks of tokens by realism.
pub const TASK: TrainingTask = TrainingTask {
    id: ID,
    also: &[],
    title: "Fine-tuning of `ntp-reactive`, `smart` and their relatives by the Sim Agents metametric",
    simulators: &["ntp-reactive", "ntp-guarded", "smart", "smart-projected"],
    defaults: || {
        let learner = Settings {
            epochs: 1.0,
            batch: 4,
            learning_rate: 1e-4,
            warm_up: 10,
            floor: 0.1,
            clip: 0.5,
            validate_every: 50,
            most_held_out: 16,
            ..Settings::default()
        };
        recipe_values(&RealismRecipe::default(), &learner)
    },
    ranges: include_str!("ranges.toml"),
    recipes: &[],
    inputs: &[],
    needs_weights: true,
    make,
};

/// Id of the task.
const ID: &str = "realism";

fn make(setup: TaskSetup) -> Result<Box<dyn Trainable>, TaskError> {
    let file = setup.from.as_ref().ok_or(TaskError::NoWeights { id: ID })?;
    let (name, bytes, digest) = (file.name.clone(), file.bytes.clone(), file.digest.clone());
    let recipe: RealismRecipe = setup.recipe()?;
    if recipe.weights.realism == 0.0 && recipe.weights.reactions == 0.0 {
        let reason = "`weights.realism` and `weights.reactions` are 0: nothing is rewarded";
        return Err(TaskError::values(ID, reason));
    }
    realism(recipe, &bytes, digest, &setup.device).map_err(|source| TaskError::File {
        what: "weights",
        file: name,
        source: source.into(),
    })
}

/// Builds the training of weights of `ntp-reactive` or `smart`, or of networks with their structure, on this
/// device, which must be one without autodiff. `digest` names the weights.
///
/// # Errors
/// A message if the bytes are weights of neither, or the recipe has fewer than two rollouts.
pub fn realism(
    recipe: RealismRecipe,
    weights: &[u8],
    digest: String,
    device: &Device,
) -> Result<Box<dyn Trainable>, String> {
    if recipe.rollouts < 2 {
        return Err(format!(
            "a group of {} rollouts has nothing to compare: give at least 2",
            recipe.rollouts
        ));
    }
    let learning = device.clone().autodiff();
    let reactive = match Policy::read(weights, &learning) {
        Ok(policy) => {
            let driven = DrivenReactive::new(policy, recipe.agents, device)?;
            return Ok(Box::new(Realism::new(recipe, driven, digest, device)));
        }
        Err(error) => error,
    };
    match SmartPolicy::read(weights, &learning) {
        Ok(policy) => {
            let driven = DrivenSmart::new(policy, recipe.agents, device);
            Ok(Box::new(Realism::new(recipe, driven, digest, device)))
        }
        Err(smart) => {
            Err(format!("it has weights neither of `ntp-reactive` ({reactive}) nor of `smart` ({smart})"))
        }
    }
}

/// The fine-tuning task of a network.
struct Realism<D> {
    recipe: RealismRecipe,
    driven: D,
    /// Digest of the weights that the training begins with.
    digest: String,
    /// Device without autodiff.
    device: Device,
}

impl<D: Driven> Realism<D> {
    fn new(recipe: RealismRecipe, driven: D, digest: String, device: &Device) -> Self {
        Self { recipe, driven, digest, device: device.clone() }
    }

    /// Lets a simulator drive in scenarios. `learned` receives the groups; returns metrics, with the
    /// objective of each scenario.
    fn drive(
        &self,
        controller: &Controller,
        scenarios: &[Prepared],
        seed: u64,
        mut learned: impl FnMut(&Prepared, &Group),
    ) -> Result<Sums, String> {
        let (recipe, mut sums) = (&self.recipe, Sums::new());
        for scenario in scenarios {
            let mut objective = 0.0;
            if recipe.weights.realism > 0.0 {
                let (group, metrics) = scenario.realism(controller, recipe, seed)?;
                objective += recipe.weights.realism * recipe.features.part(metrics.likelihoods);
                sums.add("metametric", metrics.metametric, 1.0);
                learned(scenario, &group);
            }
            if recipe.weights.reactions > 0.0
                && let Some((group, fines)) = scenario.reactions(controller, recipe, seed)?
            {
                let (rollouts, agents) = (fines.len() as f64, scenario.scenario.start.agents.len() as f64);
                let fined: f64 = fines.iter().map(Fines::sum).sum();
                objective -= recipe.weights.reactions * fined / (rollouts * agents);
                for fines in &fines {
                    sums.add("av-contacts", fines.av_contacts.len() as f64, 1.0);
                    sums.add("contacts", fines.contacts.len() as f64, 1.0);
                    sums.add("lost", fines.lost.values().sum(), 1.0);
                }
                learned(scenario, &group);
            }
            sums.add("reward", objective, 1.0);
        }
        Ok(sums)
    }

    /// Returns the output that ends the training, because the network does not drive.
    fn failed(&self, cause: String) -> Output {
        let output = Output::new(Tensor::zeros([1], &self.device), 0.0, Sums::new());
        Output { failure: Some(cause), ..output }
    }
}

impl<D: Driven> Task for Realism<D> {
    type Example = Scenario;
    type Sample = Prepared;
    type Model = D::Network;

    fn init(&self, _seed: u64) -> D::Network {
        self.driven.first()
    }

    fn begins_trained(&self) -> bool {
        true
    }

    fn check(&self, scenario: &Scenario) -> Result<(), String> {
        check(scenario)
    }

    fn prepare(&self, scenario: &Scenario, _stream: Option<&mut Stream>) -> Option<Prepared> {
        Prepared::new(scenario)
    }

    /// In validation, the loss is the negative objective, by draws that are always the same.
    fn loss(&self, model: &D::Network, samples: &[Prepared], stream: Option<&mut Stream>) -> Output {
        let Some(stream) = stream else {
            let controller = self.driven.controller(model);
            let metrics = match controller.and_then(|c| self.drive(&c, samples, 0, |_, _| ())) {
                Ok(metrics) => metrics,
                Err(cause) => return self.failed(cause),
            };
            let items = metrics.weight("reward");
            let loss = -metrics.mean("reward").unwrap_or(0.0) * items;
            return Output::new(Tensor::from_floats([loss as f32], &self.device), items, metrics);
        };
        let mut learned = Vec::new();
        let driven = self.driven.noting(&model.valid()).and_then(|(controller, notes)| {
            self.drive(&controller, samples, stream.random(), |scenario, group| {
                learned.extend(self.driven.samples(&notes, &scenario.scenario, group));
            })
        });
        let metrics = match driven {
            Ok(metrics) => metrics,
            Err(cause) => return self.failed(cause),
        };
        // Without an AV that deviates, there may be no reactions to learn.
        if learned.is_empty() {
            return Output::new(Tensor::zeros([1], &self.device), 0.0, metrics);
        }
        let mut output = self.driven.loss(model, &learned, self.recipe.weights.kl);
        output.metrics.extend(&metrics);
        output
    }

    fn file(&self, model: &D::Network, metadata: &BTreeMap<String, String>) -> Option<Vec<u8>> {
        self.driven.file(model, metadata)
    }

    fn describe(&self) -> serde_json::Value {
        serde_json::json!({ "recipe": self.recipe, "from": self.digest })
    }
}

impl<D: Driven> SimulatorTask for Realism<D> {
    fn controller(&self, network: &D::Network) -> Result<Controller, String> {
        self.driven.controller(network)
    }
}
