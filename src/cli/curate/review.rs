//! `reactsim curate review`: writes the page on which people verify candidates.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;

use crate::cli::output::{ExitStatus, say, write_result};
use crate::report::page::write_review;

/// Arguments of `curate review`.
#[derive(Debug, Args)]
pub(super) struct ReviewArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Number of the first scenario of the page
    #[arg(long, default_value = "1", value_name = "N")]
    first: NonZeroUsize,
    /// Maximum number of scenarios of the page
    #[arg(long, default_value = "500", value_name = "N")]
    limit: NonZeroUsize,
    /// Write to this file instead of stdout
    #[arg(long, value_name = "PAGE")]
    out: Option<PathBuf>,
}

pub(super) fn review(args: &ReviewArgs) -> anyhow::Result<ExitStatus> {
    let (from, limit) = (args.first.get(), args.limit.get());
    let mut page = Vec::new();
    let total = write_review(&args.file, from, limit, &mut page)?;
    write_result(args.out.as_deref(), |out| out.write_all(&page))?;
    let next = from.saturating_add(limit);
    if next <= total {
        let last = next - 1;
        say(format_args!("scenarios {from} to {last} of {total}; the next page begins with --first {next}"));
    }
    Ok(ExitStatus::Done)
}
