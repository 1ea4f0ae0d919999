//! `reactsim report`: tables of finished runs, or the HTML page.

use std::io::{self, Write};
use std::path::PathBuf;

use anyhow::bail;
use clap::Args;

use super::gallery;
use super::output::{ExitStatus, write_result};
use super::table_output::{TableArgs, formats};
use crate::evaluation::{StudyResults, Summary, is_study, read_summary};
use crate::report::page::members;
use crate::report::{Run, TableStyle, study_tables};

/// Format of the page.
const HTML: &str = "html";

/// Heading of the options of the page.
const PAGE: &str = "Page (--format html)";

/// Number of scenes of a page.
const DEFAULT_CASES: usize = 12;

const AFTER: &str = "\
Examples:
  reactsim report runs/x --format csv
  reactsim report runs/x runs/y --format html --out page.html
  reactsim report runs/x --format html --scenarios logs/ --all --out page.html
  reactsim report studies/replan --format latex --bold
  reactsim report studies/replan studies/guards --format html --out studies.html

The page is one self-contained HTML file. It shows the scenes of runs that kept their rollouts \
(--keep-rollouts). Scenarios that are no longer where the runs read them are named by --scenarios.";

/// Arguments of `report`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ReportArgs {
    /// Folders of runs or studies
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Format of the table [default: terminal on a terminal, else markdown]; html is the page
    #[arg(long, value_parser = formats([HTML]))]
    format: Option<String>,
    #[command(flatten)]
    table: TableArgs,
    /// Write to this file instead of stdout
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten, next_help_heading = PAGE)]
    scenarios: gallery::RunScenarioArgs,
    /// Number of scenes, of the scenarios in which simulators differ most [default: 12]
    #[arg(long, value_name = "N", help_heading = PAGE)]
    cases: Option<usize>,
    /// Also show the scene of this scenario; may be repeated
    #[arg(long = "case", value_name = "ID", help_heading = PAGE)]
    case: Vec<String>,
    /// Show the scenes of all scenarios
    #[arg(long, help_heading = PAGE)]
    all: bool,
}

pub(super) fn report(args: &ReportArgs) -> anyhow::Result<ExitStatus> {
    if args.format.as_deref() == Some(HTML) {
        return page(args);
    }
    let of_page = [
        ("--scenarios", args.scenarios.is_given()),
        ("--cases", args.cases.is_some()),
        ("--case", !args.case.is_empty()),
        ("--all", args.all),
    ];
    if let Some((option, _)) = of_page.into_iter().find(|(_, is_given)| *is_given) {
        bail!("{option} is for the page: give --format html, or leave it out");
    }
    args.table.check(args.format.as_deref())?;
    if let [folder] = args.runs.as_slice()
        && is_study(folder)
        && let Some(write) = study_format(args.format.as_deref())
    {
        let results = StudyResults::read(folder)?;
        write_result(args.out.as_deref(), |out| write(&results, args.table.style(), out))?;
        return Ok(ExitStatus::Done);
    }
    let (members, _) = members(&args.runs)?;
    let summaries: Vec<Summary> =
        members.iter().map(|m| read_summary(&m.folder)).collect::<Result<_, _>>()?;
    let runs: Vec<Run<'_>> =
        members.iter().zip(&summaries).map(|(m, summary)| Run { name: &m.name, summary }).collect();
    args.table.write(&runs, args.format.as_deref(), args.out.as_deref(), "")?;
    Ok(ExitStatus::Done)
}

/// Writes the tables of a study.
type StudyWriter = fn(&StudyResults, TableStyle<'_>, &mut dyn Write) -> io::Result<()>;

/// Returns the writer of a format in which a single study has tables of its own. In others its members are
/// runs like any others.
fn study_format(format: Option<&str>) -> Option<StudyWriter> {
    match format {
        None | Some("markdown") => Some(study_tables::write_markdown),
        Some("latex") => Some(study_tables::write_latex),
        Some(_) => None,
    }
}

fn page(args: &ReportArgs) -> anyhow::Result<ExitStatus> {
    if !args.table.is_usual() {
        bail!("the page has switches of its own: leave the options of tables out");
    }
    let gallery = gallery::open(&args.runs, &args.scenarios)?;
    let mut page = Vec::new();
    gallery.write(&args.case, args.cases.unwrap_or(DEFAULT_CASES), args.all, &mut page)?;
    write_result(args.out.as_deref(), |out| out.write_all(&page))?;
    Ok(ExitStatus::Done)
}
