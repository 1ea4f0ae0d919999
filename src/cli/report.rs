//! `reactsim report`: tables of finished runs.

use std::path::PathBuf;

use clap::Args;
use clap::builder::PossibleValuesParser;

use super::{ExitStatus, write_result};
use crate::evaluation::{Summary, read_summary};
use crate::report::{EXPORTERS, Run, exporter};

/// Arguments of `report`.
#[derive(Debug, Args)]
pub(super) struct ReportArgs {
    /// Run folders
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Form of the result
    #[arg(long, default_value = "markdown", value_parser = formats())]
    format: String,
    /// Write to this file instead of stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

/// The names of all forms.
pub(super) fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(EXPORTERS.iter().map(|e| e.id()))
}

pub(super) fn report(args: &ReportArgs) -> anyhow::Result<ExitStatus> {
    let summaries: Vec<Summary> = args.runs.iter().map(|p| read_summary(p)).collect::<Result<_, _>>()?;
    let names = names(&args.runs);
    let runs: Vec<Run<'_>> =
        names.iter().zip(&summaries).map(|(name, summary)| Run { name, summary }).collect();
    if let Some(exporter) = exporter(&args.format) {
        write_result(args.out.as_deref(), |out| exporter.export(&runs, out))?;
    }
    Ok(ExitStatus::Done)
}

/// The names of run folders; their whole paths where the names alone are not unique.
fn names(runs: &[PathBuf]) -> Vec<String> {
    let short: Vec<String> = runs
        .iter()
        .map(|p| p.file_name().map_or_else(|| p.display().to_string(), |n| n.to_string_lossy().into_owned()))
        .collect();
    let mut sorted = short.clone();
    sorted.sort();
    sorted.dedup();
    if sorted.len() == short.len() { short } else { runs.iter().map(|p| p.display().to_string()).collect() }
}
