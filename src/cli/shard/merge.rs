//! `reactsim shard merge`.

use std::path::Path;

use anyhow::bail;

use super::estimate::Estimate;
use super::planned::arguments;
use crate::cli::progress::Progress;
use crate::cli::run;
use crate::cli::{ExitStatus, count, say};
use crate::evaluation::shards::{self, ShardPlan};

pub(super) fn merge(folder: &Path) -> anyhow::Result<ExitStatus> {
    let plan = ShardPlan::read(folder)?;
    let args = arguments(&plan)?;
    let Some(out) = &args.out else { bail!("the plan names no folder for the results") };
    let progress = Progress::new();
    progress.set_total(Some(plan.records()));
    let ends: Vec<usize> = plan
        .units
        .iter()
        .scan(0, |end, unit| {
            *end += unit.range.count;
            Some(*end)
        })
        .collect();
    let merged = shards::merge(folder, &plan, out, &|units: usize| progress.set_done(ends[units - 1]));
    progress.end();
    let merged = merged?;
    let core_seconds = merged.units.iter().map(|unit| unit.seconds * unit.jobs as f64).sum();
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
