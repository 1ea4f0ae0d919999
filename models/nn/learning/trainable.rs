//! Trainings of any network behind one interface.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use reactsim_rollout::Controller;
use reactsim_scene::Scenario;
use serde_json::{Map, Value};

use crate::training::{Execution, Learner, Observer, Outcome, Settings, Source, Task, TrainingError};

/// A task whose network a simulator runs.
pub trait SimulatorTask: Task<Example = Scenario> + Send {
    /// Returns the simulator with this network, which has no autodiff, and the parameters of its card. The
    /// error is a message.
    fn controller(&self, network: &Self::Model) -> Result<Controller, String>;
}

/// A training of some network. Every [`SimulatorTask`] is one.
pub trait Trainable: Send + Sync {
    /// Trains in a folder.
    ///
    /// # Errors
    /// As [`Learner::learn`].
    fn learn(&self, training: Training<'_>) -> Result<Outcome<()>, TrainingError>;
}

/// Evaluates a simulator: metrics by name. The error is a message.
pub type Measure<'a> = dyn Fn(Controller) -> Result<BTreeMap<String, f64>, String> + 'a;

/// Data, settings and place of a training.
pub struct Training<'a> {
    /// Training data.
    pub source: &'a dyn Source<Example = Scenario>,
    /// Settings that determine the result.
    pub settings: Settings,
    /// Settings that do not change the result.
    pub execution: Execution,
    /// Fields written to `training.json` in addition to settings, task and data.
    pub about: Map<String, Value>,
    /// Closed-loop evaluation at every validation, if any.
    pub measure: Option<&'a Measure<'a>>,
    /// Receiver of progress events.
    pub observer: &'a dyn Observer,
    /// Folder to write.
    pub folder: &'a Path,
    /// Whether to continue the training in the folder.
    pub resume: bool,
    /// Interrupts the training when set.
    pub stop: &'a AtomicBool,
}

impl<T: SimulatorTask> Trainable for T {
    fn learn(&self, training: Training<'_>) -> Result<Outcome<()>, TrainingError> {
        let Training { source, settings, execution, about, measure, observer, folder, resume, stop } =
            training;
        let closed_loop =
            measure.map(|measure| move |network: &T::Model, _step: u64| measure(self.controller(network)?));
        let closed_loop = closed_loop.as_ref().map(|measure| measure as _);
        let learner = Learner { task: self, source, settings, execution, about, closed_loop, observer };
        let Outcome { ending, steps, best, .. } = learner.learn(folder, resume, stop)?;
        Ok(Outcome { ending, model: (), steps, best })
    }
}
