//! Realism metrics of the Sim Agents challenge for many scenarios: of a submission, or of the rollouts of a
//! run.
//!
//! [`SubmittedPairs`] and [`RunPairs`] bring logs and rollouts together, one scenario at a time;
//! [`score_all`] scores them. [`LogFiles`] finds the log of a scenario.

mod json;
mod logs;
mod run_pairs;
mod run_rollouts;
mod scores;
mod submission;
mod summary;
mod text;

pub use logs::LogFiles;
pub use run_pairs::{LogSource, RunPairs};
pub use scores::{RealismFailure, RealismRow, RealismScores, RealismSettings, ScoredPair, score_all};
pub use submission::SubmittedPairs;
pub use summary::{REALISM_ROWS, REALISM_SUMMARY, RealismSummary};
