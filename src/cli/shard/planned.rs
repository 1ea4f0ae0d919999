//! `reactsim shard plan`, and the run that a plan describes.

use std::collections::BTreeSet;
use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, Parser};

use super::estimate::Estimate;
use crate::cli::run::{self, RunArgs};
use crate::cli::{Cli, Command, ExitStatus, count, note, say};
use crate::evaluation::Plan;
use crate::evaluation::shards::ShardPlan;
use crate::external::ExternalSimulator;

/// Arguments of `shard plan`.
#[derive(Debug, Args)]
pub(super) struct PlanArgs {
    /// Folder for the plan and the units; all processes need to reach it by this name
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Records per unit: some minutes of work
    #[arg(long, default_value = "512", value_name = "N")]
    unit: NonZeroUsize,
    /// Number of records that are run to estimate time and space of the whole; 0 for no estimate
    #[arg(long, default_value_t = 48, value_name = "N")]
    estimate: usize,
    /// The run as on one machine: `run`, its arguments, and --out with the folder for its results
    #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true, value_name = "COMMAND")]
    command: Vec<String>,
}

pub(super) fn plan(args: &PlanArgs) -> anyhow::Result<ExitStatus> {
    let run = parse(&args.command)?;
    let sources = run.subject.sources()?;
    let (plan, _external) = run::plan(&run, sources)?;
    let shards = ShardPlan::of(&plan, args.command.clone(), args.unit.get())?;
    if shards.units.is_empty() {
        bail!("there is no record to run");
    }
    shards.write(&args.folder)?;
    let folder = args.folder.display();
    say(format_args!("{} in {}", count(shards.records(), "record"), count(shards.units.len(), "unit")));
    if args.estimate > 0 {
        match Estimate::measure(&args.folder, &shards, &plan, run.work.execution(), args.estimate)? {
            Some(estimate) => say(format_args!("{estimate}")),
            None => say(format_args!("no estimate: interrupted")),
        }
    }
    note(format_args!(
        "next: reactsim shard run {folder} N for every N from 0 to {}, or `--missing` for all; then reactsim \
         shard merge {folder}",
        shards.units.len() - 1
    ));
    Ok(ExitStatus::Done)
}

/// Parses the command of a run that is to be divided.
fn parse(command: &[String]) -> anyhow::Result<RunArgs> {
    let all = std::iter::once("reactsim").chain(command.iter().map(String::as_str));
    let Some(Command::Run(run)) = Cli::try_parse_from(all)?.command else {
        bail!("only `run` can be divided into units so far");
    };
    if run.out.is_none() {
        bail!("give --out FOLDER for the results of the run: `shard merge` writes it");
    }
    let refused = [("--resume", run.resume), ("--check-batch", run.check_batch.is_some())];
    if let Some((option, _)) = refused.iter().find(|(_, given)| *given) {
        bail!("{option} has no effect on a run in units: leave it out");
    }
    if run.subject.external.takes_stdout() {
        bail!("--external …=@stdio: units cannot share a parent process: give a command");
    }
    run.table.check(run.format.as_deref())?;
    Ok(run)
}

/// The run of a plan, as its arguments describe it.
pub(super) struct PlannedRun {
    pub(super) args: RunArgs,
    pub(super) plan: Plan,
    /// Kept alive as long as the plan.
    pub(super) external: Vec<ExternalSimulator>,
}

/// Returns the arguments of the planned run.
pub(super) fn arguments(shards: &ShardPlan) -> anyhow::Result<RunArgs> {
    parse(&shards.arguments).context("the arguments in the plan are not those of a run")
}

/// Prepares the planned run for some of its units. Only their files are read for their digests.
pub(super) fn prepare(shards: &ShardPlan, units: &[usize]) -> anyhow::Result<PlannedRun> {
    let args = arguments(shards)?;
    let inputs: Result<BTreeSet<usize>, _> =
        units.iter().map(|number| shards.unit(*number).map(|unit| unit.range.input)).collect();
    let sources = args.subject.known_sources(&shards.provenance.inputs, &inputs?);
    let sources = sources.context("paths in the plan are relative to the folder in which it was made")?;
    let (plan, external) = run::plan(&args, sources)?;
    Ok(PlannedRun { args, plan, external })
}
