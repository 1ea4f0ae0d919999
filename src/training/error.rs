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
