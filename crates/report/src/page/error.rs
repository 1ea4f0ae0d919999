//! Errors of the page.

use std::io;

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
    /// Runs or scenarios are repeated, unknown or not there; the text names them.
    #[error("{0}")]
    Refused(String),
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
