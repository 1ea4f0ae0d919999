//! `reactsim curate`: deviated AVs from any logs, their figures, and what people decided about them.

mod apply;
mod make;
mod review;
mod stats;

use std::path::Path;

use anyhow::bail;
use clap::{Args, Subcommand};

use super::ExitStatus;

/// Arguments of `curate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub(super) struct CurateArgs {
    #[command(subcommand)]
    command: Option<CurateCommand>,
    #[command(flatten)]
    make: Option<make::MakeArgs>,
}

#[derive(Debug, Subcommand)]
enum CurateCommand {
    /// Print the figures of a file of candidates: categories, distances, pressure, what fell where
    Stats(stats::StatsArgs),
    /// Verify candidates by hand in a browser
    Review(review::ReviewArgs),
    /// Write a file anew with what reviewers decided
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
