//! The log: one line of JSON per step and per validation.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::TrainingError;

/// A row of the log. All fields except `wall` are reproducible.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "row", rename_all = "snake_case")]
pub enum Row {
    /// A step of the optimiser.
    Step(StepRow),
    /// A validation on the held-out examples.
    Validation(ValidationRow),
}

/// A step of the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// Number of the step, from 1.
    pub step: u64,
    /// Epochs done after the step.
    pub epoch: f64,
    /// Mean loss over the items of the batch; `None` for an empty batch.
    pub loss: Option<f64>,
    /// Learning rate.
    pub learning_rate: f64,
    /// Norm of the gradient of the mean loss, before clipping.
    pub gradient_norm: f64,
    /// Number of items in the batch, or the sum of their weights.
    pub items: f64,
    /// Number of examples that yielded a sample.
    pub samples: usize,
    /// Further metrics of the task.
    pub metrics: BTreeMap<String, f64>,
    /// Wall time.
    pub wall: Wall,
}

/// A validation on the held-out examples.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValidationRow {
    /// Number of steps taken before.
    pub step: u64,
    /// Epochs done.
    pub epoch: f64,
    /// Mean loss over the items.
    pub loss: f64,
    /// Whether this loss is the lowest so far.
    pub best: bool,
    /// Number of items, or the sum of their weights.
    pub items: f64,
    /// Number of examples.
    pub samples: usize,
    /// Further metrics of the task.
    pub metrics: BTreeMap<String, f64>,
    /// Metrics of the closed-loop evaluation.
    pub closed_loop: BTreeMap<String, f64>,
    /// Wall time.
    pub wall: Wall,
}

/// Wall times, which differ between repetitions of a training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// Seconds since the training began, without interruptions.
    pub seconds: f64,
    /// Examples per second in this step.
    pub per_second: f64,
    /// Memory in use by the program, bytes; 0 where the operating system does not tell.
    #[serde(default)]
    pub memory: u64,
}

impl Row {
    /// Returns the number of the step, or of the last step before a validation.
    pub fn step(&self) -> u64 {
        match self {
            Self::Step(row) => row.step,
            Self::Validation(row) => row.step,
        }
    }

    /// Returns the row as a line of JSON.
    pub(super) fn line(&self) -> String {
        let mut line = serde_json::to_string(self).expect("a row is text and numbers");
        line.push('\n');
        line
    }
}

/// Reads the rows of a log up to the first incomplete line, which a killed training leaves.
///
/// # Errors
/// [`TrainingError::Unreadable`] if the file cannot be read.
pub fn read_log(path: &Path) -> Result<Vec<Row>, TrainingError> {
    let refuse = |e: std::io::Error| TrainingError::Unreadable { path: path.to_owned(), why: e.to_string() };
    let text = String::from_utf8_lossy(&fs::read(path).map_err(refuse)?).into_owned();
    Ok(text.split_inclusive('\n').map_while(|line| serde_json::from_str(line).ok()).collect())
}
