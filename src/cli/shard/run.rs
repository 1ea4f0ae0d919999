//! `reactsim shard run`.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{anyhow, bail};
use clap::Args;

use super::planned::command;
use crate::cli::progress::Progress;
use crate::cli::sharded::WorkSettings;
use crate::cli::subject::JobsArg;
use crate::cli::{ExitStatus, count, is_quiet, say, stop_on_interrupt};
use crate::shards::{ShardPlan, UnitOutcome, UnitWorker};

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
    let command = command(&shards)?;
    let (folder, jobs, progress) = (args.folder.as_path(), args.jobs.or(command.jobs()), Progress::new());
    let total: Result<Vec<usize>, _> =
        units.iter().map(|number| shards.unit(*number).map(|unit| unit.range.count)).collect();
    progress.set_total(Some(total?.iter().sum()));
    let settings = WorkSettings { folder, jobs, progress: &progress, stop: &stop };
    let work = command.prepare(&shards, &units, settings)?;
    let worker = UnitWorker { folder, plan: &shards, work: work.as_ref(), jobs };
    let (mut failed, mut refused, mut done) = (0, 0, 0);
    for &number in &units {
        let begin = Instant::now();
        let outcome = worker.run(number, &|| begin.elapsed().as_secs_f64());
        done += shards.unit(number)?.range.count;
        progress.begin_part(done);
        match outcome {
            Ok(UnitOutcome::Finished(record)) => {
                failed += record.failed;
                if is_quiet() {
                    continue;
                }
                let rate = record.records as f64 / record.seconds.max(1e-3);
                progress.say(format_args!(
                    "unit {number}: {}, {:.1} s, {rate:.1}/s{}",
                    count(record.records, "record"),
                    record.seconds,
                    if record.failed == 0 { String::new() } else { format!(", {} failed", record.failed) }
                ));
            }
            Ok(UnitOutcome::WasFinished) => {
                progress.say(format_args!("unit {number}: already finished"));
            }
            Ok(UnitOutcome::Interrupted) => {
                progress.end();
                return Ok(ExitStatus::Interrupted);
            }
            Err(error) => {
                let error = anyhow!("unit {number}: {:#}", anyhow::Error::from(error));
                if units.len() == 1 {
                    progress.end();
                    return Err(error);
                }
                // Other units may well be possible.
                progress.say(format_args!("warning: {error}"));
                refused += 1;
            }
        }
    }
    progress.end();
    if refused > 0 {
        bail!("{refused} of {} did not run: see the warnings above", count(units.len(), "unit"));
    }
    Ok(if failed > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}
