//! `reactsim shard merge`.

use std::path::Path;

use super::estimate::Estimate;
use super::planned::command;
use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, say};
use crate::shards::{FinishedUnits, ShardPlan};

pub(super) fn merge(folder: &Path) -> anyhow::Result<ExitStatus> {
    let plan = ShardPlan::read(folder)?;
    let command = command(&plan)?;
    let units = FinishedUnits::of(&plan, folder)?;
    let progress = Progress::new();
    progress.set_total(Some(plan.records()));
    let status = command.merge(&plan, &units, &progress);
    progress.end();
    let status = status?;
    say(format_args!("merged {} in {}", count(plan.records(), "record"), count(plan.units.len(), "unit")));
    let abandoned = units.remove_abandoned()?;
    if abandoned > 0 {
        say(format_args!("removed {} of killed processes", count(abandoned, "partial folder")));
    }
    if let Some(estimate) = Estimate::kept(folder)? {
        let core_seconds = units.units.iter().map(|unit| unit.record.core_seconds()).sum();
        say(format_args!("{}", estimate.against(core_seconds)));
    }
    Ok(status)
}
