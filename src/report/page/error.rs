//! Why a page can not be made.

use std::io;

use crate::evaluation::EvaluationError;
use crate::web::ServeError;

/// Why a page can not be made or served.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PageError {
    /// A run can not be read.
    #[error(transparent)]
    Run(#[from] EvaluationError),
    /// Two runs are of the same name.
    #[error("two runs are named `{0}`: give each once")]
    SameRun(String),
    /// A scenario that was asked for is in none of the runs.
    #[error("no run has a scenario `{0}`; `rows.jsonl` of a run folder names those that it has")]
    UnknownScenario(String),
    /// A number or text has no form in JSON.
    #[error("the page's data can not be written as JSON: {0}")]
    Json(#[from] serde_json::Error),
    /// The page can not be written.
    #[error("could not write the page: {0}")]
    Write(#[from] io::Error),
    /// The page can not be served.
    #[error(transparent)]
    Serve(#[from] ServeError),
}
