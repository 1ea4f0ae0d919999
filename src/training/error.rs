//! Why a training does not begin, or ends.

use std::io;
use std::path::PathBuf;

/// Why a training does not begin, or ends early.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum TrainingError {
    /// A setting can not be.
    #[error("{0}")]
    Setting(String),
    /// There is nothing to learn from.
    #[error("there is nothing to learn from: {0}")]
    NoData(String),
    /// The loss or its gradient is no number any more.
    #[error(
        "the {what} is {value} at step {step}, with {}: try a lower learning rate, or look at these scenarios",
        named(.examples)
    )]
    NotFinite {
        /// What is not finite.
        what: &'static str,
        /// Its value.
        value: f64,
        /// The step, counted from 1.
        step: u64,
        /// The names of the examples that the network was run on.
        examples: Vec<String>,
    },
    /// An example can not be read.
    #[error("could not read {example}: {cause}")]
    Read {
        /// Its name.
        example: String,
        /// Why.
        cause: String,
    },
    /// A file can not be read, or is not what it should be.
    #[error("{}: {why}", .path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
    },
    /// The last checkpoint can not be used.
    #[error("can not resume from {}: {why}; {mend}", .path.display())]
    Checkpoint {
        /// The file.
        path: PathBuf,
        /// Why.
        why: String,
        /// What to do.
        mend: String,
    },
    /// The folder holds a training already.
    #[error(
        "{} holds a training already; give --resume to go on with it, or choose another folder", .path.display()
    )]
    Exists {
        /// The folder.
        path: PathBuf,
    },
    /// The folder holds another training.
    #[error("can not resume {}: {differences}; give the same settings and data, or another folder", .path.display())]
    OtherTraining {
        /// The folder.
        path: PathBuf,
        /// What differs.
        differences: String,
    },
    /// Another training writes to the folder.
    #[error("another training is writing to {}", .path.display())]
    Busy {
        /// The folder.
        path: PathBuf,
    },
    /// What is measured in closed loop can not be.
    #[error("could not validate in closed loop: {0}")]
    ClosedLoop(String),
    /// A file can not be written.
    #[error("could not write {}: {source}", .path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's answer.
        source: io::Error,
    },
}

/// A list of names for people.
fn named(examples: &[String]) -> String {
    if examples.is_empty() { "no scenario".to_owned() } else { format!("scenario {}", examples.join(", ")) }
}
