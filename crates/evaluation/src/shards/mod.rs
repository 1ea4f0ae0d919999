//! Runs and studies in units: [`ShardedRuns`] is what a plan records of them, [`RunWork`] carries out their
//! units, [`merge`] joins the results of a run into its run folder.

mod merge;
mod subject;
mod work;

pub use merge::merge;
pub use subject::{Runs, ShardedRun, ShardedRuns};
pub use work::RunWork;

/// Name of the file with the scenarios that a unit left out.
const LEFT_OUT: &str = "left_out.json";
