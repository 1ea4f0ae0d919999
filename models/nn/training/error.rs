//! Errors of trainings.

use std::io;
use std::path::PathBuf;

/// Error that prevents a training or ends it early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting is invalid.
    #[error("{0}")]
    Setting(String),
    /// There is nothing to learn from.
    #[error("there is nothing to learn from: {0}")]
    NoData(String),
    /// The loss or its gradient is not finite.
    #[error(
        "the {what} is {value} at step {step}, with {}: try a lower learning rate, or check these scenarios",
        named(.examples)
    )]
    NotFinite {
        /// Quantity that is not finite.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Step, counted from 1.
        step: u64,
        /// Names of the examples that the network was run on.
        examples: Vec<String>,
    },
    /// The task has no result for examples.
    #[error("step {step}: {cause}")]
    Failed {
        /// Step, counted from 1.
        step: u64,
        /// Reason.
        cause: String,
    },
    /// An example cannot be read.
    #[error("could not read {example}: {cause}")]
    Read {
        /// Name of the example.
        example: String,
        /// Reason.
        cause: String,
    },
    /// A file cannot be read or has unexpected content.
    #[error("{}: {why}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Reason.
        why: String,
    },
    /// The last checkpoint cannot be used.
    #[error("cannot resume from {}: {why}; {mend}", .path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Reason.
        why: String,
        /// Suggested remedy.
        mend: String,
    },
    /// The folder holds a training already.
    #[error(
        "{} already holds a training; continue it with `resume`, or choose another folder", .path.display()
    )]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds another training.
    #[error(
        "cannot resume {}: {differences}; give the same settings and data, or another folder", .path.display()
    )]
    OtherTraining {
        /// The folder.
        path: PathBuf,
        /// Differences between the two trainings.
        differences: String,
    },
    /// The weights of the best network so far are no longer in the folder, and no checkpoint contains them.
    #[error(
        "{} is missing: it had the best network so far, that of step {best}, and the checkpoint is of step \
         {step}; put it back, or train again in another folder",
        .path.display()
    )]
    WeightsLost {
        /// The file.
        path: PathBuf,
        /// Step of the best network.
        best: u64,
        /// Step of the checkpoint.
        step: u64,
    },
    /// Another training writes to the folder.
    #[error("another training is writing to {}", .path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// The closed-loop validation failed.
    #[error("could not validate in closed loop: {0}")]
    ClosedLoop(String),
    /// A file cannot be written.
    #[error("could not write {}: {source}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Error of the operating system.
        source: io::Error,
    },
}

/// Formats a list of names.
fn named(examples: &[String]) -> String {
    if examples.is_empty() { "no scenario".to_owned() } else { format!("scenario {}", examples.join(", ")) }
}
