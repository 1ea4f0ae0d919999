//! `reactsim shard run`.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{anyhow, bail};
use clap::Args;

use super::planned::{PlannedRun, prepare};
use crate::cli::external::keep_stderr;
use crate::cli::progress::Progress;
use crate::cli::subject::JobsArg;
use crate::cli::{ExitStatus, count, is_quiet, say, stop_on_interrupt};
use crate::evaluation::shards::{ShardPlan, UnitOutcome, UnitWorker};

/// Arguments of `shard run`.
#[derive(Debug, Args)]
pub(super) struct UnitArgs {
    /// Folder of the plan and the units
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Numbers of the units, from 0
    #[arg(value_name = "UNIT", required_unless_present = "missing", conflicts_with = "missing")]
    units: Vec<usize>,
    /// All units that are not finished, one after the other
    #[arg(long)]
    missing: bool,
    #[command(flatten)]
    jobs: JobsArg,
}

pub(super) fn run(args: &UnitArgs) -> anyhow::Result<ExitStatus> {
    let shards = ShardPlan::read(&args.folder)?;
    let units = match args.missing {
        true => shards.missing(&args.folder),
        false => args.units.clone(),
    };
    if units.is_empty() {
        say(format_args!("all {} are finished", count(shards.units.len(), "unit")));
        return Ok(ExitStatus::Done);
    }
    let stop = stop_on_interrupt("stopping; units that are finished stay")?;
    let PlannedRun { args: run, plan, external } = prepare(&shards, &units)?;
    keep_stderr(&external, Some(&args.folder))?;
    let mut execution = run.work.execution();
    execution.jobs = args.jobs.or(execution.jobs);
    let (mut failed, mut refused) = (0, 0);
    for &number in &units {
        let progress = Progress::new();
        progress.set_total(Some(shards.unit(number)?.range.count));
        let begin = Instant::now();
        let seconds = || begin.elapsed().as_secs_f64();
        let folder = args.folder.as_path();
        let worker =
            UnitWorker { folder, shards: &shards, plan: &plan, execution, observer: &progress, stop: &stop };
        let outcome = worker.run(number, &seconds);
        progress.end();
        match outcome {
            Ok(UnitOutcome::Finished(record)) => {
                failed += record.failed;
                if is_quiet() {
                    continue;
                }
                let rate = record.records as f64 / record.seconds.max(1e-3);
                say(format_args!(
                    "unit {number}: {}, {:.1} s, {rate:.1}/s{}",
                    count(record.records, "record"),
                    record.seconds,
                    if record.failed == 0 { String::new() } else { format!(", {} failed", record.failed) }
                ));
            }
            Ok(UnitOutcome::WasFinished) => say(format_args!("unit {number}: already finished")),
            Ok(UnitOutcome::Interrupted) => return Ok(ExitStatus::Interrupted),
            Err(error) => {
                let error = anyhow!("unit {number}: {:#}", anyhow::Error::from(error));
                if units.len() == 1 {
                    return Err(error);
                }
                // Other units may well be possible.
                say(format_args!("warning: {error}"));
                refused += 1;
            }
        }
    }
    if refused > 0 {
        bail!("{refused} of {} are not carried out: see the warnings above", count(units.len(), "unit"));
    }
    Ok(if failed > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}
