//! Errors of the page.

use std::io;
use std::path::PathBuf;

use reactsim_evaluation::EvaluationError;
use reactsim_formats::FormatError;

use crate::web::ServeError;

/// Error in creating or serving a page.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    /// A run cannot be read.
    #[error(transparent)]
    Run(#[from] EvaluationError),
    /// A file of candidates cannot be read.
    #[error(transparent)]
    Candidates(#[from] FormatError),
    /// A file of candidates has no scenario that the page could show.
    #[error("{path} has {total} scenarios with candidates: there is none to review from number {from} on")]
    NoCandidates {
        /// The file.
        path: PathBuf,
        /// Number of the first scenario of the page.
        from: usize,
        /// Number of scenarios in the file.
        total: usize,
    },
    /// Two runs have the same name.
    #[error("two runs are named `{0}`: give each once")]
    SameRun(String),
    /// A requested scenario is in none of the runs.
    #[error("no run has a scenario `{0}`; `rows.jsonl` of a run folder lists its scenarios")]
    UnknownScenario(String),
    /// The data cannot be represented as JSON.
    #[error("could not write the data of the page as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The page cannot be written.
    #[error("could not write the page: {0}")]
    Write(#[from] io::Error),
    /// The page cannot be served.
    #[error(transparent)]
    Serve(#[from] ServeError),
}
