//! `reactsim run`: runs simulators on scenarios.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use anyhow::bail;
use clap::Args;

use super::external::{Outside, check_batches};
use super::finished::{outcomes, put_table, report_left_out, report_notes, report_problems, show_next_steps};
use super::live_table::LiveTable;
use super::partition::{self, PartitionArg, Partitions};
use super::progress::Progress;
use super::subject::{EvaluationArgs, ExecutionArgs, ProtocolName};
use super::table_output::{TableArgs, formats};
use super::{ExitStatus, is_verbose, note, nothing, say, stop_on_interrupt};
use crate::evaluation::{self, Outcome, Plan, RunFolder, Source, Summary};
use crate::external::RunOutline;
use crate::models::qp::Smoothing;
use crate::report::Run;
use crate::rollout::{Replan, Settings};

/// Stage behind simulators, or none. The alias keeps clap from treating it as an optional argument.
type Stage = std::option::Option<Smoothing>;

/// Arguments of `run`.
#[derive(Debug, Args)]
pub(super) struct RunArgs {
    #[command(flatten)]
    pub(super) subject: EvaluationArgs,
    /// Smoothing stage after every simulator except log replay: qp (smooth, within limits, on the
    /// road, clear of other agents) or qp-alone (ignores other agents). It becomes part of the id, as
    /// in idm+qp; --models takes such ids too
    #[arg(long, default_value = "off", value_name = "STAGE", value_parser = smoothing)]
    smooth: Stage,
    /// reactive: the AV is an external input (Algorithm 1); realism: the simulator also moves the AV
    /// (Algorithm 2)
    #[arg(long, value_enum, default_value = "reactive")]
    protocol: ProtocolName,
    /// Replan rate or interval, such as 2hz or 5steps
    #[arg(long, default_value = "2hz", value_name = "RATE")]
    replan: Replan,
    /// For step t+1, agents see the AV up to t+1 (1) or only up to t (0)
    #[arg(long, default_value = "1", value_name = "0|1", value_parser = ["0", "1"])]
    av_lookahead: String,
    /// Rollouts per scenario and simulator
    #[arg(long, default_value_t = 1, value_name = "R",
          value_parser = clap::value_parser!(u32).range(1..=10_000))]
    rollouts: u32,
    /// Run folder to write: provenance, rows, events, summary [default: only print the table]
    #[arg(long, value_name = "FOLDER")]
    pub(super) out: Option<PathBuf>,
    /// Continue the interrupted run in --out
    #[arg(long, requires = "out")]
    pub(super) resume: bool,
    /// Repeat the first K scenarios of external simulators one at a time after the run, and report
    /// the largest difference to their batches
    #[arg(long, value_name = "K", requires = "external", help_heading = "External simulators")]
    pub(super) check_batch: Option<NonZeroUsize>,
    /// Keep the rollouts in the run folder
    #[arg(long, requires = "out")]
    pub(super) keep_rollouts: bool,
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

pub(super) fn run(args: RunArgs) -> anyhow::Result<ExitStatus> {
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

/// Executes a run until `stop` is set. `None` if it was interrupted.
pub(super) fn finished_until(
    args: &RunArgs,
    stop: &AtomicBool,
) -> anyhow::Result<Option<(Option<RunFolder>, Summary)>> {
    // Report every input error before the first scenario.
    if args.subject.external.takes_stdout() && args.out.is_none() {
        bail!("@stdio: standard output belongs to the simulator or planner: give --out FOLDER");
    }
    args.table.check(args.format.as_deref())?;
    let (plan, outside) = plan(args, args.subject.sources(args.partition.partition)?)?;
    let (folder, tally) = plan.open_folder(args.out.as_deref(), args.resume)?;
    outside.keep_stderr(args.out.as_deref())?;
    let progress = Progress::with_table(LiveTable::of(&plan.simulators));
    let execution = args.work.execution();
    let outcome = evaluation::run(&plan, execution, folder.as_ref(), tally, &progress, stop);
    progress.end();
    outside.report_faults(args.out.as_deref());
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
                check_batches(&plan, &outside.simulators, count)?;
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
    if !args.subject.external.takes_stdout() {
        let below = if is_verbose() { outcomes(summary) } else { String::new() };
        args.table.write(&[Run { name: "", summary }], args.format.as_deref(), None, &below)?;
    }
    report_problems(summary);
    match &args.out {
        Some(_) if args.partition.partition.is_some() => return Ok(ExitStatus::Done),
        Some(path) => show_next_steps(path, args.keep_rollouts),
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
pub(super) fn plan(args: &RunArgs, sources: Vec<Source>) -> anyhow::Result<(Plan, Outside)> {
    let subject = &args.subject;
    let settings = Settings {
        protocol: args.protocol.into(),
        replan: args.replan,
        av_lookahead: args.av_lookahead == "1",
        seed: subject.seed,
    };
    let (simulators, outside) = subject.simulators(args.smooth, &RunOutline::of(&settings))?;
    let mut plan =
        subject.plan(sources, simulators, &outside, settings, args.rollouts, args.keep_rollouts)?;
    plan.partition = args.partition.partition;
    Ok((plan, outside))
}

/// Parses the name of a stage; `off` is none.
fn smoothing(name: &str) -> Result<Option<Smoothing>, String> {
    if name == "off" {
        return Ok(None);
    }
    let all = || Smoothing::ALL.map(Smoothing::name).join(", ");
    Smoothing::from_name(name).map(Some).ok_or_else(|| format!("expected {} or off", all()))
}
