//! `reactsim curate`: deviated AVs from any logs, their statistics, and the decisions of reviewers.

mod apply;
mod make;
mod review;
mod source;
mod stats;

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::{Args, Subcommand};

use super::output::ExitStatus;
use super::partition::{PartitionArg, Partitions};
use crate::evaluation::ReadingSpec;

const AFTER: &str = "\
Step 1 keeps scenarios with vehicles around the AV. Step 2 proposes candidates. Step 3 drops \
candidates that are infeasible, do not pressure any agent or cannot be avoided. Step 4 chooses at \
most one candidate per scenario.

Examples:
  reactsim curate LOGS --out a.parquet             propose, filter and choose candidates
  reactsim curate LOGS --source file:c.parquet --out a.parquet
                                                   the same with the candidates of your planner
  reactsim curate stats a.parquet                  print statistics of the result
  reactsim curate review a.parquet --out a.html    verify candidates in a browser
  reactsim curate apply a.parquet a.parquet.decisions.jsonl --out b.parquet
                                                   apply the decisions that the page exported
  reactsim run LOGS --deviations b.parquet         run simulators against the chosen AVs";

/// Arguments of `curate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = AFTER)]
pub(super) struct CurateArgs {
    #[command(subcommand)]
    command: Option<CurateCommand>,
    #[command(flatten)]
    make: Option<make::MakeArgs>,
    // Not within the optional arguments: their presence would no longer be recognised.
    #[command(flatten)]
    reading: ReadingSpec,
    #[command(flatten)]
    partition: PartitionArg,
}

#[derive(Debug, Subcommand)]
enum CurateCommand {
    /// Print statistics of a file of candidates: categories, distances to the log, rejections
    Stats(stats::StatsArgs),
    /// Write an HTML page on which candidates are verified by hand
    Review(review::ReviewArgs),
    /// Apply the decisions of a review and write a new file of candidates
    Apply(apply::ApplyArgs),
}

pub(super) fn curate(args: &CurateArgs) -> anyhow::Result<ExitStatus> {
    match (&args.command, &args.make) {
        (Some(CurateCommand::Stats(args)), _) => stats::stats(args),
        (Some(CurateCommand::Review(args)), _) => review::review(args),
        (Some(CurateCommand::Apply(args)), _) => apply::apply(args),
        (None, Some(make)) => make::make(make, &args.reading, args.partition.partition),
        (None, None) => bail!("name files or folders of scenarios, or one of `stats`, `review` and `apply`"),
    }
}

/// Joins the partitions of a curation.
pub(super) fn merge(args: CurateArgs, partitions: &Partitions, out: PathBuf) -> anyhow::Result<ExitStatus> {
    make::merge(args.make.context("partition.json is damaged: it has no scenarios")?, partitions, out)
}
