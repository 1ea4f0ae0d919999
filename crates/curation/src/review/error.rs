//! Errors of a review.

use std::io;
use std::path::PathBuf;

use reactsim_formats::FormatError;
use reactsim_web::ServeError;

/// Reason why candidates cannot be reviewed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReviewError {
    /// The journal cannot be read.
    #[error("could not read the decisions in {path}: {source}")]
    Read {
        /// The journal.
        path: PathBuf,
        /// Reason.
        source: io::Error,
    },
    /// A decision cannot be written; it does not count.
    #[error("could not write to the decisions in {path}: {source}")]
    Write {
        /// The journal.
        path: PathBuf,
        /// Reason.
        source: io::Error,
    },
    /// Another server has the journal open for writing.
    #[error(
        "the decisions in {path} are being written by another review of the same file; \
         close that one first, or review in its page"
    )]
    Locked {
        /// The journal.
        path: PathBuf,
    },
    /// A line of the journal is not a decision.
    #[error("{path}, line {line}: {found}; repair or remove this line")]
    Line {
        /// The journal.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// Description of the problem.
        found: String,
    },
    /// An invalid decision.
    #[error("{field} of the decision about scenario `{scenario}` is {value}, expected {expected}")]
    Decision {
        /// Id of the scenario.
        scenario: String,
        /// Name of the field.
        field: &'static str,
        /// The value found.
        value: String,
        /// The expected value.
        expected: String,
    },
    /// The name of the reviewer is missing or unusable.
    #[error(
        "the name of the reviewer is `{name}`, expected 1 to 100 characters on one line; \
         type it in the page, or give --reviewer"
    )]
    Reviewer {
        /// The name found.
        name: String,
    },
    /// A response cannot be encoded as JSON.
    #[error("scenario `{scenario}` cannot be encoded as JSON: {source}")]
    Encode {
        /// Id of the scenario, possibly empty.
        scenario: String,
        /// Reason.
        source: serde_json::Error,
    },
    /// The file of candidates cannot be read.
    #[error(transparent)]
    Data(#[from] FormatError),
    /// The file holds nothing to review.
    #[error("{path} holds no scenario: there is nothing to review")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The page cannot be served.
    #[error(transparent)]
    Serve(#[from] ServeError),
}
