//! What is logged: one line of JSON per step and per validation.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::TrainingError;

/// A line of the log. All but `wall` is the same whenever and wherever the same training is done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "row", rename_all = "snake_case")]
pub enum Row {
    /// A step of the optimiser.
    Step(StepRow),
    /// A look at what is held out.
    Validation(ValidationRow),
}

/// A step of the optimiser.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct StepRow {
    /// Its number, from 1.
    pub step: u64,
    /// How often the data were gone through after it.
    pub epoch: f64,
    /// Mean loss over the items of the batch; `None` where there were none.
    pub loss: Option<f64>,
    /// Learning rate.
    pub learning_rate: f64,
    /// Norm of the gradient of the mean loss, before it was clipped.
    pub gradient_norm: f64,
    /// Items in the batch, or the sum of their weights.
    pub items: f64,
    /// Examples with something to learn.
    pub samples: usize,
    /// What else the task measures.
    pub metrics: BTreeMap<String, f64>,
    /// Clocks.
    pub wall: Wall,
}

/// A look at what is held out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ValidationRow {
    /// Steps that were taken before.
    pub step: u64,
    /// How often the data were gone through.
    pub epoch: f64,
    /// Mean loss over the items.
    pub loss: f64,
    /// Whether no earlier one was as low.
    pub best: bool,
    /// Items, or the sum of their weights.
    pub items: f64,
    /// Examples.
    pub samples: usize,
    /// What else the task measures.
    pub metrics: BTreeMap<String, f64>,
    /// What was measured in closed loop.
    pub closed_loop: BTreeMap<String, f64>,
    /// Clocks.
    pub wall: Wall,
}

/// What clocks said: no part of what is the same in every training.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wall {
    /// Seconds since the training began, without those between an interruption and its continuation.
    pub seconds: f64,
    /// Examples per second in this step.
    pub per_second: f64,
}

impl Row {
    /// The number of the step that the row is about, or that came before.
    pub fn step(&self) -> u64 {
        match self {
            Self::Step(row) => row.step,
            Self::Validation(row) => row.step,
        }
    }

    /// The row as a line of the log.
    pub(super) fn line(&self) -> String {
        let mut line = serde_json::to_string(self).expect("a row is text and numbers");
        line.push('\n');
        line
    }
}

/// The rows of a log; a line that was torn by a kill ends it.
///
/// # Errors
/// [`TrainingError::Unreadable`] when the file can not be read.
pub fn read_log(path: &Path) -> Result<Vec<Row>, TrainingError> {
    let refuse = |e: std::io::Error| TrainingError::Unreadable { path: path.to_owned(), why: e.to_string() };
    let text = String::from_utf8_lossy(&fs::read(path).map_err(refuse)?).into_owned();
    Ok(text.split_inclusive('\n').map_while(|line| serde_json::from_str(line).ok()).collect())
}
