//! `reactsim shard merge`.

use std::path::Path;

use anyhow::bail;

use super::estimate::Estimate;
use super::planned::arguments;
use crate::cli::progress::Progress;
use crate::cli::run;
use crate::cli::{ExitStatus, count, say};
use crate::evaluation::shards::{self, ShardPlan, UnitRecord};

pub(super) fn merge(folder: &Path) -> anyhow::Result<ExitStatus> {
    let plan = ShardPlan::read(folder)?;
    let args = arguments(&plan)?;
    let Some(out) = &args.out else { bail!("the plan names no folder for the results") };
    let progress = Progress::new();
    progress.set_total(Some(plan.records()));
    let merged = shards::merge(folder, &plan, out, &|records| progress.set_done(records));
    progress.end();
    let merged = merged?;
    let core_seconds = merged.units.iter().map(UnitRecord::core_seconds).sum();
    let records = merged.units.iter().map(|unit| unit.records).sum();
    say(format_args!("merged {} in {}", count(records, "record"), count(merged.units.len(), "unit")));
    if merged.abandoned > 0 {
        say(format_args!("removed {} of killed processes", count(merged.abandoned, "partial folder")));
    }
    if let Some(estimate) = Estimate::kept(folder)? {
        say(format_args!("{}", estimate.against(core_seconds)));
    }
    run::finish(&args, Some(&merged.folder), &merged.summary)
}
