//! A run in units.

use anyhow::{Context, bail};

use super::{RunArgs, finish, plan};
use crate::cli::ExitStatus;
use crate::cli::external::Outside;
use crate::cli::progress::Progress;
use crate::cli::sharded::{Sharded, WorkSettings, refuse};
use crate::cli::subject::EvaluationArgs;
use crate::evaluation::shards::{RunWork, Runs, ShardedRuns, merge};
use crate::evaluation::{Execution, Source};
use crate::shards::{FinishedUnits, ShardPlan, Work};

impl Sharded for RunArgs {
    fn check(&self) -> anyhow::Result<()> {
        if self.out.is_none() {
            bail!("give --out FOLDER for the results of the run: `shard merge` writes it");
        }
        refuse(&[("--resume", self.resume), ("--check-batch", self.check_batch.is_some())])?;
        refuse_stdout(&self.subject)?;
        self.table.check(self.format.as_deref())
    }

    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan> {
        let (mut plan, _outside) = plan(self, self.subject.sources()?)?;
        divide(&mut plan, arguments, records)
    }

    fn jobs(&self) -> usize {
        self.work.execution().jobs
    }

    fn prepare<'a>(
        &'a self,
        shards: &ShardPlan,
        units: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>> {
        let planned: ShardedRuns = shards.subject()?;
        let sources = known_sources(&self.subject, shards, &planned, units)?;
        let (plan, outside) = plan(self, sources)?;
        work(Box::new(plan), &outside, planned, self.work.execution(), settings)
    }

    fn merge(
        &self,
        plan: &ShardPlan,
        units: &FinishedUnits,
        progress: &Progress,
    ) -> anyhow::Result<ExitStatus> {
        let planned: ShardedRuns = plan.subject()?;
        let (Some(out), [run]) = (&self.out, planned.runs.as_slice()) else {
            bail!("the plan is damaged: it has no --out or several runs; plan again");
        };
        let merged = merge(units.of_part(0), run, out, &|records| progress.set_done(records));
        progress.end();
        let (folder, summary) = merged?;
        finish(self, Some(&folder), &summary)
    }
}

/// Divides runs into units of this many records.
pub(crate) fn divide(
    runs: &mut dyn Runs,
    arguments: Vec<String>,
    records: usize,
) -> anyhow::Result<ShardPlan> {
    let (subject, ranges) = ShardedRuns::divide(runs, records)?;
    Ok(ShardPlan::new(arguments, &subject, ranges)?)
}

/// Prepares units of runs with these external simulators and planners.
pub(in crate::cli) fn work<'a>(
    runs: Box<dyn Runs>,
    outside: &Outside,
    planned: ShardedRuns,
    execution: Execution,
    settings: WorkSettings<'a>,
) -> anyhow::Result<Box<dyn Work + 'a>> {
    outside.keep_stderr(Some(settings.folder))?;
    let execution = Execution { jobs: settings.jobs, ..execution };
    Ok(Box::new(RunWork::new(runs, planned, execution, settings.progress, settings.stop)))
}

/// Refuses an external simulator that talks with the parent process.
pub(in crate::cli) fn refuse_stdout(subject: &EvaluationArgs) -> anyhow::Result<()> {
    if subject.external.takes_stdout() {
        bail!("--external …=@stdio: units cannot share a parent process: give a command");
    }
    Ok(())
}

/// Returns the sources of planned runs for some units. Only their files are read for their digests.
pub(in crate::cli) fn known_sources(
    subject: &EvaluationArgs,
    shards: &ShardPlan,
    planned: &ShardedRuns,
    units: &[usize],
) -> anyhow::Result<Vec<Source>> {
    let Some(run) = planned.runs.first() else { bail!("the plan is damaged: it has no run; plan again") };
    let sources = subject.known_sources(&run.provenance.inputs, &shards.inputs_of(units)?);
    sources.context("paths in the plan are relative to the folder in which it was made")
}
