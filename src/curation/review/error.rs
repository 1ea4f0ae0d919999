//! What can go wrong with a review.

use std::io;
use std::path::PathBuf;

use crate::formats::FormatError;
use crate::web::ServeError;

/// Why candidates can not be reviewed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReviewError {
    /// The journal can not be read.
    #[error("could not read the decisions in {path}: {source}")]
    Read {
        /// The journal.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// A decision can not be written; it does not count.
    #[error("could not write to the decisions in {path}: {source}")]
    Write {
        /// The journal.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Another server writes to the journal.
    #[error(
        "the decisions in {path} are being written by another review of the same file; end that one first, or review in its page"
    )]
    Locked {
        /// The journal.
        path: PathBuf,
    },
    /// A line of the journal is no decision.
    #[error("{path}, line {line}: {found}; mend or remove this line")]
    Line {
        /// The journal.
        path: PathBuf,
        /// Number of the line, from 1.
        line: usize,
        /// What is wrong with it.
        found: String,
    },
    /// A decision that makes no sense.
    #[error("{field} of the decision about scenario `{scenario}` is {value}, expected {expected}")]
    Decision {
        /// Id of the scenario.
        scenario: String,
        /// Name of the field.
        field: &'static str,
        /// The value found.
        value: String,
        /// What was expected instead.
        expected: String,
    },
    /// Nobody decides, or somebody without a fit name.
    #[error(
        "the name of the reviewer is `{name}`, expected 1 to 100 characters; type it in the page, or give --reviewer"
    )]
    Reviewer {
        /// The name found.
        name: String,
    },
    /// An answer can not be written as JSON.
    #[error("scenario `{scenario}` can not be written as JSON: {source}")]
    Encode {
        /// Id of the scenario, possibly empty.
        scenario: String,
        /// Why.
        source: serde_json::Error,
    },
    /// The file of candidates can not be read.
    #[error(transparent)]
    Data(#[from] FormatError),
    /// The file holds nothing to review.
    #[error("{path} holds no scenario: there is nothing to review")]
    Empty {
        /// The file.
        path: PathBuf,
    },
    /// The page can not be served.
    #[error(transparent)]
    Serve(#[from] ServeError),
}
