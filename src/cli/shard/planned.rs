//! `reactsim shard plan`, and the command that a plan describes.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, FromArgMatches};

use super::estimate::Estimate;
use crate::cli::sharded::Sharded;
use crate::cli::{Cli, Command, ExitStatus, command_line, count, end, note, say};
use crate::shards::ShardPlan;

/// Arguments of `shard plan`.
#[derive(Debug, Args)]
pub(super) struct PlanArgs {
    /// Folder for the plan and the units; all processes need to reach it by this name
    #[arg(value_name = "FOLDER")]
    folder: PathBuf,
    /// Records per unit: some minutes of work
    #[arg(long, default_value = "512", value_name = "N")]
    unit: NonZeroUsize,
    /// Number of records that are worked on to estimate time and space of the whole, more if they take less
    /// than two seconds; 0 for no estimate
    #[arg(long, default_value_t = 48, value_name = "N")]
    estimate: usize,
    /// The command as on one machine: run, study, curate, generate or score --wosac, with --out for its
    /// results
    #[arg(required = true, trailing_var_arg = true, allow_hyphen_values = true, value_name = "COMMAND")]
    command: Vec<String>,
}

pub(super) fn plan(args: &PlanArgs) -> anyhow::Result<ExitStatus> {
    let command = parse(&args.command)?;
    let shards = command.divide(args.command.clone(), args.unit.get())?;
    if shards.units.is_empty() {
        bail!("there is no record to work on");
    }
    shards.write(&args.folder)?;
    let folder = args.folder.display();
    say(format_args!("{} in {}", count(shards.records(), "record"), count(shards.units.len(), "unit")));
    if args.estimate > 0 {
        match Estimate::measure(&args.folder, &shards, command.as_ref(), args.estimate)? {
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

/// Parses a command that is to be divided.
fn parse(command: &[String]) -> anyhow::Result<Box<dyn Sharded>> {
    let all = std::iter::once("reactsim").chain(command.iter().map(String::as_str));
    let matches = command_line().try_get_matches_from(all);
    let matches = matches.or_else(|error| if error.use_stderr() { Err(error) } else { end(&error) })?;
    let command: Box<dyn Sharded> = match Cli::from_arg_matches(&matches)?.command {
        Some(Command::Run(run)) => Box::new(run),
        Some(Command::Study(study)) => Box::new(study),
        Some(Command::Curate(curate)) => Box::new(curate),
        Some(Command::Generate(generate)) => Box::new(generate),
        Some(Command::Score(score)) => Box::new(score),
        _ => bail!("only run, study, curate, generate and score --wosac can be divided into units"),
    };
    command.check()?;
    Ok(command)
}

/// Returns the command of a plan.
pub(super) fn command(shards: &ShardPlan) -> anyhow::Result<Box<dyn Sharded>> {
    parse(&shards.arguments).context("the arguments in the plan are not those of work in units")
}
