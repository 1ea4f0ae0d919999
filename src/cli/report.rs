//! `reactsim report`: tables of finished runs, and the page.

use std::path::PathBuf;

use anyhow::bail;
use clap::Args;
use clap::builder::PossibleValuesParser;

use super::also::Also;
use super::{ExitStatus, gallery, say, write_result};
use crate::evaluation::{Summary, read_summary};
use crate::report::{EXPORTERS, Run, exporter};

/// The form that is a page.
const HTML: &str = "html";

const AFTER: &str = "\
  reactsim report runs/x --format csv
  reactsim report runs/x runs/y --format html --out page.html
  reactsim report runs/x --format html --scenarios logs/ --all --out page.html
  reactsim report studies/replan studies/guards --format html --out studies.html

The page is one file that opens anywhere. Scenes are drawn for runs that were made with --keep-rollouts; the
shipped benchmark is always at hand, other scenarios are found with --scenarios.";

/// Arguments of `report`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ReportArgs {
    /// Folders of runs or studies
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Form of the result
    #[arg(long, default_value = "markdown",
          value_parser = PossibleValuesParser::new(EXPORTERS.iter().map(|e| e.id()).chain([HTML])))]
    format: String,
    #[command(flatten)]
    also: Also,
    /// Write to this file instead of stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// For the page: where the scenarios of the runs lie; may be repeated
    #[arg(long, value_name = "PATH")]
    scenarios: Vec<PathBuf>,
    /// For the page: so many scenes, of the scenarios in which simulators differ most
    #[arg(long, value_name = "N", default_value_t = 12)]
    cases: usize,
    /// For the page: the scene of this scenario too; may be repeated
    #[arg(long = "case", value_name = "ID")]
    case: Vec<String>,
    /// For the page: the scenes of all scenarios
    #[arg(long)]
    all: bool,
}

/// The names of all forms of tables.
pub(super) fn formats() -> PossibleValuesParser {
    PossibleValuesParser::new(EXPORTERS.iter().map(|e| e.id()))
}

pub(super) fn report(args: &ReportArgs) -> anyhow::Result<ExitStatus> {
    if args.format == HTML {
        return page(args);
    }
    let (members, _) = gallery::members(&args.runs)?;
    let summaries: Vec<Summary> =
        members.iter().map(|m| read_summary(&m.folder)).collect::<Result<_, _>>()?;
    let runs: Vec<Run<'_>> =
        members.iter().zip(&summaries).map(|(m, summary)| Run { name: &m.name, summary }).collect();
    if let Some(exporter) = exporter(&args.format) {
        write_result(args.out.as_deref(), |out| exporter.export(&runs, args.also.columns(), out))?;
    }
    Ok(ExitStatus::Done)
}

fn page(args: &ReportArgs) -> anyhow::Result<ExitStatus> {
    if !args.also.columns().is_empty() {
        bail!("the page shows every metric on request: leave --also out");
    }
    let gallery = gallery::open(&args.runs, &args.scenarios)?;
    for lack in gallery.lacks() {
        say(format_args!("note: {lack}"));
    }
    let mut page = Vec::new();
    gallery.write(&args.case, args.cases, args.all, &mut page)?;
    write_result(args.out.as_deref(), |out| out.write_all(&page))?;
    Ok(ExitStatus::Done)
}
