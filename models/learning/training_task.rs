//! Training tasks as entries of a list.

use std::collections::BTreeMap;
use std::error::Error;

use burn::tensor::Device;
use reactsim_baseline::{ModelError, Parameters, WeightsFile};
use reactsim_training::Settings;
use serde::de::DeserializeOwned;
use toml::Table;

use super::Trainable;
use super::recipe::{LEARNING, recipe_parameters};

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
    #[error("the task `{id}` needs a file `{name}`: give --input {name}=FILE")]
    NoInput {
        /// Id of the task.
        id: &'static str,
        /// Name of the input.
        name: &'static str,
    },
    /// The task needs weights to start from.
    #[error("the task `{id}` continues from the weights of another training: give --from FILE")]
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
    /// [`TaskError::File`] with the cause.
    pub fn parent<T, E: Into<Box<dyn Error + Send + Sync>>>(
        &self,
        read: impl FnOnce(&[u8], &Device) -> Result<T, E>,
    ) -> Result<Option<(T, String)>, TaskError> {
        let Some(file) = &self.from else { return Ok(None) };
        let parent = read(&file.bytes, &self.device.clone().autodiff());
        parent.map(|parent| Some((parent, file.digest.clone()))).map_err(|e| self.refuse_parent(e))
    }

    /// Returns the error that the weights to start from do not fit.
    pub fn refuse_parent(&self, source: impl Into<Box<dyn Error + Send + Sync>>) -> TaskError {
        let file = self.from.as_ref().map(|file| file.name.clone()).unwrap_or_default();
        TaskError::File { what: "weights", file, source: source.into() }
    }

    /// Returns the error that the network of the weights to start from differs from that of the recipe.
    pub fn refuse_parent_sizes(&self) -> TaskError {
        self.refuse_parent("its network has other sizes than the recipe: give the recipe the same `network`")
    }

    /// Reads an input file, if it is given.
    ///
    /// # Errors
    /// [`TaskError::File`] with the cause.
    pub fn input<T, E: Into<Box<dyn Error + Send + Sync>>>(
        &self,
        name: &'static str,
        read: impl FnOnce(&[u8]) -> Result<T, E>,
    ) -> Result<Option<T>, TaskError> {
        let Some(file) = self.inputs.get(name) else { return Ok(None) };
        let refuse = |e: E| TaskError::File { what: name, file: file.name.clone(), source: e.into() };
        read(&file.bytes).map(Some).map_err(refuse)
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
