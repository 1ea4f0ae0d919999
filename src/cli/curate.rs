//! `reactsim curate`: deviated AVs from any logs, their figures, and what people decided about them.

mod apply;
mod make;
mod review;
mod stats;

use std::path::Path;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::ExitStatus;

const AFTER: &str = "\
Step 1 keeps scenarios with vehicles around the AV; step 2 proposes candidates; step 3 drops
those that are not feasible, press nobody or can not be avoided; step 4 chooses at most one per
scenario.

  reactsim curate LOGS --out a.parquet             make candidates, filter and choose
  reactsim curate stats a.parquet                  see what came out
  reactsim curate review a.parquet                 decide by hand, in a browser
  reactsim curate apply a.parquet --out b.parquet  fold the decisions in
  reactsim run LOGS --deviations b.parquet         run simulators against the set";

/// Arguments of `curate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true, after_help = AFTER)]
pub(super) struct CurateArgs {
    #[command(subcommand)]
    command: Option<CurateCommand>,
    #[command(flatten)]
    make: Option<make::MakeArgs>,
}

#[derive(Debug, Subcommand)]
enum CurateCommand {
    /// Print what a file of candidates is like: categories, distances to the log, what fell where
    Stats(stats::StatsArgs),
    /// Verify candidates by hand in a browser
    Review(review::ReviewArgs),
    /// Fold the decisions of a review into a new file of candidates
    Apply(apply::ApplyArgs),
}

pub(super) fn curate(args: &CurateArgs) -> anyhow::Result<ExitStatus> {
    match (&args.command, &args.make) {
        (Some(CurateCommand::Stats(args)), _) => stats::stats(args),
        (Some(CurateCommand::Review(args)), _) => review::review(args),
        (Some(CurateCommand::Apply(args)), _) => apply::apply(args),
        (None, Some(args)) => make::make(args),
        (None, None) => bail!("name files or folders of scenarios, or one of `stats`, `review` and `apply`"),
    }
}

/// Whether two paths lead to the same file.
fn is_same(a: &Path, b: &Path) -> bool {
    matches!((a.canonicalize(), b.canonicalize()), (Ok(a), Ok(b)) if a == b)
}
