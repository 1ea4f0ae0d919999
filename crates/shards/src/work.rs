//! What is divided.

use std::path::Path;

use super::{ShardError, ShardPlan, Unit};

/// Work of which every unit can be carried out by itself.
pub trait Work {
    /// Checks that this process would carry out the planned work, as far as the records of a unit are
    /// concerned.
    ///
    /// # Errors
    /// [`ShardError::OtherWork`] names the first setting that differs.
    fn check(&self, plan: &ShardPlan, unit: &Unit) -> Result<(), ShardError>;

    /// Carries out the records of a unit and writes the results to an empty folder. `None` if it was
    /// interrupted.
    ///
    /// # Errors
    /// [`ShardError`] if results cannot be written, or records are missing.
    fn carry_out(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, ShardError>;
}

/// Results of a unit in a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnitResults {
    /// Number of records that were read.
    pub records: usize,
    /// Number of failures.
    pub failed: usize,
    /// Names of the files that a merge reads; others are not kept.
    pub files: Vec<&'static str>,
}
