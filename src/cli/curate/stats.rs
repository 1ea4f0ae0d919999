//! `reactsim curate stats`: statistics of a file of candidates.

use std::path::PathBuf;

use clap::Args;

use crate::cli::output::{ExitStatus, write_result};
use crate::curation::stats::Statistics;
use crate::report::curation_tables;

/// Arguments of `curate stats`.
#[derive(Debug, Args)]
pub(super) struct StatsArgs {
    /// A file that `curate` wrote
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Format of the output
    #[arg(long, default_value = "text", value_parser = ["text", "json"])]
    format: String,
}

pub(super) fn stats(args: &StatsArgs) -> anyhow::Result<ExitStatus> {
    let statistics = Statistics::of_file(&args.file)?;
    write_result(None, |out| match args.format.as_str() {
        "json" => writeln!(out, "{}", serde_json::to_string_pretty(&statistics)?),
        _ => curation_tables::write_statistics(out, &statistics),
    })?;
    Ok(ExitStatus::Done)
}
