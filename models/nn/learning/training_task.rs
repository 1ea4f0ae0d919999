//! Training tasks as entries of a list.

use std::collections::BTreeMap;
use std::error::Error;

use burn::tensor::Device;
use reactsim_baseline::{ModelError, Parameters, WeightsFile};
use serde::de::DeserializeOwned;
use toml::Table;

use super::Trainable;
use super::recipe::{LEARNING, recipe_parameters};
use crate::training::Settings;

/// A kind of training, as `list tasks` shows it.
#[derive(Clone, Copy, Debug)]
pub struct TrainingTask {
    /// Stable id, such as `ntp-reactive`.
    pub id: &'static str,
    /// Earlier names, which are accepted too.
    pub also: &'static [&'static str],
    /// One-line description.
    pub title: &'static str,
    /// Ids of the simulators that read the trained weights.
    pub simulators: &'static [&'static str],
    /// Returns the default values of a recipe.
    pub defaults: fn() -> Table,
    /// Units and ranges of these values (TOML), without the table `learning`.
    pub ranges: &'static str,
    /// Recipes that ship with the program.
    pub recipes: &'static [ShippedRecipe],
    /// Files that the task can be given.
    pub inputs: &'static [TaskInput],
    /// Whether the task continues from weights of an earlier training, which must be given.
    pub needs_weights: bool,
    /// Builds the training.
    pub make: fn(TaskSetup) -> Result<Box<dyn Trainable>, TaskError>,
}

/// A recipe that ships with the program. It states only what differs from the defaults.
#[derive(Clone, Copy, Debug)]
pub struct ShippedRecipe {
    /// Name, such as `quick`.
    pub name: &'static str,
    /// One-line description.
    pub about: &'static str,
    /// The recipe (TOML).
    pub text: &'static str,
}

/// A file that a task can be given.
#[derive(Clone, Copy, Debug)]
pub struct TaskInput {
    /// Name, such as `vocabulary`.
    pub name: &'static str,
    /// One-line description, with the default.
    pub about: &'static str,
    /// Whether it must be given, unless the training continues from weights.
    pub required: bool,
}

/// Everything that a training is built from, other than the data.
#[derive(Debug)]
pub struct TaskSetup {
    /// Values of the recipe, with changes applied.
    pub recipe: Parameters,
    /// Files by the name of their input.
    pub inputs: BTreeMap<&'static str, WeightsFile>,
    /// Weights to start from.
    pub from: Option<WeightsFile>,
    /// Device of the network, without autodiff.
    pub device: Device,
}

/// Error from building a training.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TaskError {
    /// The recipe is invalid.
    #[error(transparent)]
    Recipe(#[from] ModelError),
    /// Values of the recipe do not fit together.
    #[error("the recipe of `{id}`: {source}")]
    Values {
        /// Id of the task.
        id: &'static str,
        /// Cause, naming the values.
        source: Box<dyn Error + Send + Sync>,
    },
    /// An input file or the weights to start from cannot be used.
    #[error("cannot use the {what} {file}: {source}")]
    File {
        /// Kind of file, such as `vocabulary`.
        what: &'static str,
        /// Name of the file.
        file: String,
        /// Cause.
        source: Box<dyn Error + Send + Sync>,
    },
    /// The task needs an input file.
    #[error("the task `{id}` needs a file `{name}`: give `input` {name}=FILE")]
    NoInput {
        /// Id of the task.
        id: &'static str,
        /// Name of the input.
        name: &'static str,
    },
    /// The task needs weights to start from.
    #[error("the task `{id}` continues from the weights of another training: give its file as `from`")]
    NoWeights {
        /// Id of the task.
        id: &'static str,
    },
}

impl TaskError {
    /// Returns the error that values of the recipe do not fit together.
    pub fn values(id: &'static str, source: impl Into<Box<dyn Error + Send + Sync>>) -> Self {
        Self::Values { id, source: source.into() }
    }
}

impl TrainingTask {
    /// Returns the default recipe.
    ///
    /// # Errors
    /// [`ModelError`] if the ranges cannot be read or do not hold the values; a test rules it out.
    pub fn recipe(&self) -> Result<Parameters, ModelError> {
        recipe_parameters(self.id, (self.defaults)(), self.ranges)
    }
}

impl TaskSetup {
    /// Returns the task's part of the recipe.
    ///
    /// # Errors
    /// [`ModelError`] naming the value that is invalid.
    pub fn recipe<T: DeserializeOwned>(&self) -> Result<T, ModelError> {
        self.recipe.clone().split_off(LEARNING).0.get()
    }

    /// Reads the weights to start from, if they are given, on the device with autodiff. Returns what was
    /// read, and the digest of the file.
    ///
    /// # Errors
    /// [`TaskError::File`] with the cause, or if the sizes of the network do not fit the recipe.
    pub fn parent<T, E: Into<Box<dyn Error + Send + Sync>>>(
        &self,
        read: impl FnOnce(&[u8], &Device) -> Result<T, E>,
        fits: impl FnOnce(&T) -> bool,
    ) -> Result<Option<(T, String)>, TaskError> {
        let Some(file) = &self.from else { return Ok(None) };
        let refuse = |source| TaskError::File { what: "weights", file: file.name.clone(), source };
        let parent = read(&file.bytes, &self.device.clone().autodiff()).map_err(|e| refuse(e.into()))?;
        if !fits(&parent) {
            let cause = "its network has other sizes than the recipe: give the recipe the same `network`";
            return Err(refuse(cause.into()));
        }
        Ok(Some((parent, file.digest.clone())))
    }

    /// Reads an input file, if it is given; otherwise returns that of the parent.
    ///
    /// # Errors
    /// [`TaskError::File`] with the cause, or if the file differs from that of the parent.
    pub fn input<T: PartialEq, E: Into<Box<dyn Error + Send + Sync>>>(
        &self,
        name: &'static str,
        read: impl FnOnce(&[u8]) -> Result<T, E>,
        of_parent: Option<T>,
    ) -> Result<Option<T>, TaskError> {
        let Some(file) = self.inputs.get(name) else { return Ok(of_parent) };
        let refuse = |source| TaskError::File { what: name, file: file.name.clone(), source };
        let given = read(&file.bytes).map_err(|e| refuse(e.into()))?;
        if of_parent.is_some_and(|other| other != given) {
            return Err(refuse("the weights to start from have another one: omit it".into()));
        }
        Ok(Some(given))
    }
}

/// Returns the learner's settings of a recipe, with this seed.
///
/// # Errors
/// [`ModelError`] naming the value that is invalid.
pub fn learning_settings(recipe: &Parameters, seed: u64) -> Result<Settings, ModelError> {
    let settings: Settings = recipe.clone().split_off(LEARNING).1.get()?;
    Ok(Settings { seed, ..settings })
}
