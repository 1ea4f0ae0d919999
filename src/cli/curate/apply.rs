//! `reactsim curate apply`: decisions of reviewers into a new file.

use std::path::PathBuf;

use clap::Args;

use crate::cli::ExitStatus;

/// Arguments of `curate apply`.
#[derive(Debug, Args)]
pub(super) struct ApplyArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Journals of decisions, besides the one beside FILE
    #[arg(long, num_args = 1.., value_name = "JOURNAL")]
    reviews: Vec<PathBuf>,
    /// The file to write
    #[arg(long, value_name = "FILE2")]
    out: PathBuf,
}

pub(super) fn apply(args: &ApplyArgs) -> anyhow::Result<ExitStatus> {
    todo(args)
}
fn todo(_: &ApplyArgs) -> anyhow::Result<ExitStatus> {
    anyhow::bail!("not yet")
}
