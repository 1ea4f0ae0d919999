//! `reactsim inspect`: prints and draws a scenario.

mod description;
mod live;
mod pictures;
mod recorded;

use std::path::PathBuf;

use anyhow::{anyhow, bail};
use clap::Args;

use super::{ExitStatus, ReadingArgs, say, write_result};
use crate::evaluation::{CASE_STUDIES, CaseStudy, Source};
use crate::formats::{self, FormatError};
use crate::scene::Scenario;

/// Arguments of `inspect`.
#[derive(Debug, Args)]
#[command(after_help = AFTER, group = clap::ArgGroup::new("picture").multiple(true))]
pub(super) struct InspectArgs {
    /// File or folder of scenarios [default: the shipped benchmark]
    #[arg(value_name = "SCENARIO")]
    scenario: Option<PathBuf>,
    /// Id of the scenario [default: the first one]
    #[arg(long)]
    id: Option<String>,
    /// A case study of the shipped benchmark; `list cases` names them
    #[arg(long = "case", value_name = "NAME",
          value_parser = case_study, conflicts_with_all = ["scenario", "id"])]
    case_study: Option<&'static CaseStudy>,
    #[command(flatten)]
    reading: ReadingArgs,
    /// Draw a rollout of this run folder (written with --keep-rollouts)
    #[arg(long, value_name = "RUN", requires_all = ["simulator", "picture"])]
    rollout: Option<PathBuf>,
    /// Simulator to draw; for --gif several, separated by commas, side by side. Without --rollout
    /// the program first runs it against the scenario's deviated AV
    #[arg(long, value_name = "ID", value_delimiter = ',', requires = "picture")]
    simulator: Vec<String>,
    /// Index of the rollout
    #[arg(long, value_name = "N", default_value_t = 0)]
    index: u32,
    /// Half of the side of a picture, metres [default: 60; for --gif large enough for the AV's path,
    /// or 40 with --follow]
    #[arg(long, value_name = "M")]
    radius: Option<f64>,
    /// Draw stills to this file
    #[arg(long, value_name = "FILE", group = "picture")]
    svg: Option<PathBuf>,
    /// Steps of the stills, 0 (current frame) to 80, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "0", value_name = "STEPS",
          value_parser = clap::value_parser!(u8).range(0..=80))]
    steps: Vec<u8>,
    /// Draw an animation to this file
    #[arg(long, value_name = "FILE", group = "picture")]
    gif: Option<PathBuf>,
    /// Side of a panel of the animation, pixels, 100 to 1200
    #[arg(long, value_name = "PIXELS", default_value_t = 480, requires = "gif",
          value_parser = clap::value_parser!(u32).range(100..=1200))]
    size: u32,
    /// Show only every Nth step; 1 is 10 frames per second
    #[arg(long, value_name = "N", default_value_t = 1, requires = "gif",
          value_parser = clap::value_parser!(u8).range(1..=40))]
    every: u8,
    /// Keep the AV in the middle of the animation, which makes larger files
    #[arg(long, requires = "gif")]
    follow: bool,
}

const AFTER: &str = "\
Without --simulator an animation shows what happens if nobody reacts: the AV follows the
scenario's deviated trajectory, and all other agents follow the log. A scenario without a
deviated AV is shown as recorded.

Example:
  reactsim inspect --case cut-in --simulator log-replay,idm --gif cut-in.gif";

pub(super) fn inspect(args: &InspectArgs) -> anyhow::Result<ExitStatus> {
    if let Some(radius) = args.radius.filter(|r| !(5.0..=1000.0).contains(r)) {
        bail!("--radius is {radius}, expected 5 to 1000 m");
    }
    if args.svg.is_some() && args.simulator.len() > 1 {
        bail!("--svg draws one rollout: give one --simulator, or draw all of them with --gif alone");
    }
    let scenario = find(args)?;
    pictures::draw(args, &scenario)?;
    let lines = description::describe(&scenario);
    let width = lines.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    write_result(None, |out| {
        lines.iter().try_for_each(|(name, text)| writeln!(out, "{name:width$}  {text}"))
    })?;
    Ok(ExitStatus::Done)
}

/// Finds the requested scenario, or the first one if no id is given.
fn find(args: &InspectArgs) -> anyhow::Result<Scenario> {
    let id = args.case_study.map(|c| c.scenario).or(args.id.as_deref());
    let Some(path) = &args.scenario else {
        if args.reading.current_frame.is_some() {
            bail!("the shipped scenarios have a fixed current frame: leave --current-frame out");
        }
        let scenarios = Source::shipped(usize::MAX).scenarios()?;
        return pick(scenarios, id, "the shipped benchmark");
    };
    let inputs = args.reading.find_inputs(std::slice::from_ref(path))?;
    pick(formats::open_all(inputs)?, id, &path.display().to_string())
}

/// Returns the scenario with this id, or the first one; `place` names the input in messages.
fn pick(
    mut scenarios: impl Iterator<Item = Result<Scenario, FormatError>>,
    id: Option<&str>,
    place: &str,
) -> anyhow::Result<Scenario> {
    let Some(id) = id else {
        let first = scenarios.next().ok_or_else(|| anyhow!("{place} is empty"))??;
        if scenarios.next().is_some() {
            say(format_args!("note: there are more scenarios; choose one with --id"));
        }
        return Ok(first);
    };
    let mut bad = 0;
    for scenario in scenarios {
        match scenario {
            Ok(scenario) if scenario.id == id => return Ok(scenario),
            Ok(_) => {}
            Err(error) => {
                bad += 1;
                say(format_args!("warning: {error}"));
            }
        }
    }
    let damaged = if bad > 0 { format!(" ({bad} records cannot be read)") } else { String::new() };
    bail!("{place} holds no scenario `{id}`{damaged}")
}

/// Parses the name of a case study.
fn case_study(name: &str) -> Result<&'static CaseStudy, String> {
    let all = || CASE_STUDIES.map(|c| c.name).join(", ");
    CaseStudy::from_name(name).ok_or_else(|| format!("expected {}", all()))
}
