//! Commands that can be divided into units.

use std::path::Path;
use std::sync::atomic::AtomicBool;

use super::ExitStatus;
use super::progress::Progress;
use crate::shards::{FinishedUnits, ShardPlan, Work};

/// How a process carries out units; nothing here changes results.
#[derive(Clone, Copy)]
pub(super) struct WorkSettings<'a> {
    /// Folder of the plan and the units.
    pub(super) folder: &'a Path,
    /// Number of threads.
    pub(super) jobs: usize,
    /// Shows what is finished.
    pub(super) progress: &'a Progress,
    /// Interrupts the work when it is set.
    pub(super) stop: &'a AtomicBool,
}

/// A command that can be divided into units.
pub(super) trait Sharded {
    /// Refuses options that have no effect or no meaning in units, and missing ones.
    fn check(&self) -> anyhow::Result<()>;

    /// Divides the work into units of this many records. `arguments` are those of the command.
    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan>;

    /// Returns the number of threads that the command names, or else that of this machine.
    fn jobs(&self) -> usize;

    /// Prepares some units of the planned work. Where possible, only their inputs are read.
    fn prepare<'a>(
        &'a self,
        plan: &ShardPlan,
        units: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>>;

    /// Joins the results of all units, and ends as the command does on one machine.
    fn merge(
        &self,
        plan: &ShardPlan,
        units: &FinishedUnits,
        progress: &Progress,
    ) -> anyhow::Result<ExitStatus>;
}

/// Refuses options of a command in units.
pub(super) fn refuse(options: &[(&str, bool)]) -> anyhow::Result<()> {
    match options.iter().find(|(_, is_given)| *is_given) {
        Some((option, _)) => anyhow::bail!("{option} has no effect on work in units: leave it out"),
        None => Ok(()),
    }
}
