//! `reactsim run`: runs simulators on scenarios.

use std::ffi::OsString;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::bail;
use clap::{Args, FromArgMatches};

use super::external::{check_batches, keep_stderr, report_faults};
use super::finished::{outcomes, put_table, report_left_out, report_notes, report_problems, show_next_steps};
use super::inputs::sources;
use super::live_table::LiveTable;
use super::output::{ExitStatus, is_verbose, note, nothing, say, stop_on_interrupt, write_result};
use super::partition::{self, PartitionArg, Partitions};
use super::progress::Progress;
use super::subject::{ExecutionArgs, drivers};
use super::table_output::{TableArgs, formats};
use crate::evaluation::{
    self, ExternalPrograms, Opening, Outcome, Plan, RunFolder, RunParts, RunSpec, Source, Specification,
    Summary,
};
use crate::report::Run;
use crate::rollout::Entering;

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    pub(super) spec: Specification,
    /// Run folder to write: provenance, rows, events, summary [default: only print the table]
    #[arg(long, value_name = "FOLDER")]
    pub(super) out: Option<PathBuf>,
    /// Continue the interrupted run in --out
    #[arg(long, requires = "out")]
    pub(super) resume: bool,
    /// Repeat the first K scenarios of external simulators one at a time after the run, and report
    /// the largest difference to their batches
    #[arg(long, value_name = "K", help_heading = "External simulators")]
    pub(super) check_batch: Option<NonZeroUsize>,
    /// Print the specification of the run, and do not run it. `reactsim run FILE.toml` runs a file of it; options
    /// on the command line take precedence
    #[arg(long)]
    print_spec: bool,
    #[command(flatten)]
    pub(super) work: ExecutionArgs,
    #[command(flatten)]
    partition: PartitionArg,
    /// Format of the table [default: terminal on a terminal, else markdown]
    #[arg(long, value_parser = formats([]))]
    pub(super) format: Option<String>,
    #[command(flatten)]
    pub(super) table: TableArgs,
}

impl RunArgs {
    /// Parses a command line that begins with `run`.
    pub(super) fn parse(line: Vec<OsString>) -> Result<Self, clap::Error> {
        Self::from_arg_matches(&Self::augment_args(clap::Command::new("run")).try_get_matches_from(line)?)
    }
}

pub(super) fn run(args: RunArgs) -> anyhow::Result<ExitStatus> {
    if args.print_spec {
        let text = args.spec.value.to_toml()?;
        write_result(None, |out| out.write_all(text.as_bytes()))?;
        return Ok(ExitStatus::Done);
    }
    let stop = stop_on_interrupt(if args.out.is_some() { "writing what is finished" } else { "stopping" })?;
    run_until(args, &stop)
}

/// Executes a run until `stop` is set, and prints its table.
pub(super) fn run_until(args: RunArgs, stop: &AtomicBool) -> anyhow::Result<ExitStatus> {
    match finished_until(&args, stop)? {
        Some((folder, summary)) => {
            let status = finish(&args, folder.as_ref(), &summary)?;
            match (args.partition.partition, &args.out) {
                (Some(partition), Some(out)) => {
                    partition::finish(out, partition, summary.provenance.failures.len(), &())
                }
                _ => Ok(status),
            }
        }
        None => Ok(ExitStatus::Interrupted),
    }
}

/// Joins the partitions of a run and prints its table.
pub(super) fn merge(mut args: RunArgs, partitions: &Partitions, out: PathBuf) -> anyhow::Result<ExitStatus> {
    let (folder, summary) = evaluation::merge(&partitions.folders, &out)?;
    (args.out, args.partition.partition) = (Some(out), None);
    finish(&args, Some(&folder), &summary)
}

/// Executes a run until `stop` is set. `None` if it was interrupted. External programs have ended then, so
/// that standard output is free for tables even if it belonged to one.
pub(super) fn finished_until(
    args: &RunArgs,
    stop: &AtomicBool,
) -> anyhow::Result<Option<(Option<RunFolder>, Summary)>> {
    // Report every input error before the first scenario.
    let spec = &args.spec.value;
    args.table.check(args.format.as_deref())?;
    if spec.keep_rollouts == Some(true) && args.out.is_none() {
        bail!("`keep-rollouts`: rollouts are kept in a run folder: give --out FOLDER");
    }
    if args.check_batch.is_some() && spec.subject.external.external.is_empty() {
        bail!("--check-batch: no external simulator runs: give --external NAME=COMMAND");
    }
    if args.check_batch.is_some() && spec.settings().entering != Entering::Off {
        bail!("--check-batch: where agents enter, episodes run singly: leave it out, or give --entering off");
    }
    if spec.subject.external.external_batch.is_some_and(|batch| batch > 1)
        && spec.settings().entering != Entering::Off
    {
        bail!(
            "--external-batch: where agents enter, episodes run singly: leave it out, or give --entering off"
        );
    }
    let opening = args.partition.partition.map_or(Opening::Whole, Opening::Partition);
    let sources = sources(&spec.subject.input, opening, spec.subject.av.as_ref())?;
    let (plan, programs) = plan(args, sources)?;
    if let Some(out) = &args.out {
        plan.spec.to_toml_in(out)?;
    }
    let (folder, tally) = plan.open_folder(args.out.as_deref(), args.resume)?;
    if let Some(folder) = &folder {
        plan.spec.write(folder.path())?;
    }
    keep_stderr(&programs, args.out.as_deref())?;
    let progress = Progress::with_table(LiveTable::of(&plan.simulators));
    let execution = args.work.execution();
    let outcome = evaluation::run(&plan, execution, folder.as_ref(), tally, &progress, stop);
    progress.end();
    report_faults(&programs, args.out.as_deref());
    match outcome? {
        Outcome::Interrupted => {
            match &args.out {
                Some(path) => say(format_args!(
                    "interrupted; finished rows are in {}; to continue, repeat the command with --resume",
                    path.display()
                )),
                None => say(format_args!("interrupted; nothing is kept without --out")),
            }
            Ok(None)
        }
        Outcome::Finished(summary) => {
            if let Some(count) = args.check_batch {
                check_batches(&plan, &programs.simulators, count)?;
            }
            Ok(Some((folder, *summary)))
        }
    }
}

/// Writes and prints the table, and prints failures.
fn finish(args: &RunArgs, folder: Option<&RunFolder>, summary: &Summary) -> anyhow::Result<ExitStatus> {
    if let Some(folder) = folder {
        put_table(folder, summary, args.table.style())?;
    }
    if args.partition.partition.is_none() {
        report_left_out(summary);
    }
    report_notes(summary);
    if summary.provenance.scenarios == 0 {
        // A partition may have none.
        if args.partition.partition.is_some() {
            return Ok(ExitStatus::Done);
        }
        return Err(nothing("no scenario could be run"));
    }
    let below = if is_verbose() { outcomes(summary) } else { String::new() };
    args.table.write(&[Run { name: "", summary }], args.format.as_deref(), None, &below)?;
    report_problems(summary);
    match &args.out {
        Some(_) if args.partition.partition.is_some() => return Ok(ExitStatus::Done),
        Some(path) => show_next_steps(path, args.spec.value.keep_rollouts == Some(true)),
        None => note(format_args!(
            "\nnothing was kept; to look at scenes, add --out runs/first --keep-rollouts, then: \
             reactsim view runs/first"
        )),
    }
    let failed = summary.provenance.failures.len();
    if failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the table"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Plans the run of these arguments on these scenarios.
pub(super) fn plan(args: &RunArgs, sources: Vec<Source>) -> anyhow::Result<(Plan, ExternalPrograms)> {
    let spec = &args.spec.value;
    let mut simulators = spec.baselines()?;
    let programs = spec.subject.external.start(&RunSpec::outline([spec]))?;
    simulators.extend(programs.planned(spec)?);
    let drivers = drivers(&programs, std::iter::once(spec.subject.av.as_ref()))?;
    let partition = args.partition.partition;
    let plan = spec.plan(RunParts { sources, simulators, drivers, partition, ..RunParts::default() })?;
    Ok((plan, programs))
}
