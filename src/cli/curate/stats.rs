//! `reactsim curate stats`: statistics of a file of candidates.

use std::path::PathBuf;

use clap::{Args, ValueEnum};

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
    #[arg(long, value_enum, default_value = "text")]
    format: Format,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Format {
    Text,
    Json,
}

pub(super) fn stats(args: &StatsArgs) -> anyhow::Result<ExitStatus> {
    let statistics = Statistics::of_file(&args.file)?;
    write_result(None, |out| match args.format {
        Format::Text => curation_tables::write_statistics(out, &statistics),
        Format::Json => {
            serde_json::to_writer_pretty(&mut *out, &statistics)?;
            out.write_all(b"\n")
        }
    })?;
    Ok(ExitStatus::Done)
}
