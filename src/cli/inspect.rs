//! `reactsim inspect`: prints and draws a scenario.

mod description;
mod pictures;
mod recorded;

use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow, bail};
use clap::Args;

use super::inputs::inputs_of;
use super::output::{ExitStatus, say, write_result};
use crate::evaluation::suggestion::did_you_mean;
use crate::evaluation::{CASE_STUDIES, CaseStudy, ReadingSpec, RunSpec, ScenarioSpec, Source};
use crate::formats::{self, FormatError, Input};
use crate::scene::{Deviation, Scenario};

/// Arguments of `inspect`.
#[derive(Debug, Args)]
#[command(after_help = AFTER, group = clap::ArgGroup::new("picture").multiple(true))]
pub(super) struct InspectArgs {
    /// File, folder or URL of scenarios [default: those of --rollout, else the shipped benchmark]
    #[arg(value_name = "SCENARIO")]
    scenario: Option<PathBuf>,
    /// Id of the scenario [default: the first one]
    #[arg(long)]
    id: Option<String>,
    /// Category of the deviated AV of the scenario
    #[arg(long, value_name = "CATEGORY", value_parser = Deviation::ALL.map(Deviation::name))]
    category: Option<String>,
    /// A case study of the shipped benchmark; `list cases` names them
    #[arg(long = "case", value_name = "NAME",
          value_parser = case_study, conflicts_with_all = ["scenario", "id", "category"])]
    case_study: Option<&'static CaseStudy>,
    #[command(flatten)]
    reading: ReadingSpec,
    /// Draw a rollout of this run folder (written with --keep-rollouts)
    #[arg(long, value_name = "RUN", requires_all = ["simulator", "picture"])]
    rollout: Option<PathBuf>,
    /// Simulator to draw; for --gif several, separated by commas, side by side. Without --rollout
    /// the program first runs it against the scenario's deviated AV
    #[arg(long, value_name = "ID", value_delimiter = ',', requires = "picture")]
    simulator: Vec<String>,
    /// Index of the rollout
    #[arg(long, value_name = "N", default_value_t = 0, requires = "rollout")]
    index: u32,
    /// Half of the side of a picture, metres [default: 60; for --gif large enough for the AV's path,
    /// or 40 with --follow]
    #[arg(long, value_name = "M", requires = "picture")]
    radius: Option<f64>,
    /// Draw stills to this file
    #[arg(long, value_name = "FILE", group = "picture")]
    svg: Option<PathBuf>,
    /// Steps of the stills, from 0 (current frame), separated by commas
    #[arg(long, value_delimiter = ',', default_value = "0", value_name = "STEPS", requires = "svg",
          value_parser = clap::value_parser!(u16).range(0..=6000))]
    steps: Vec<u16>,
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
Without --simulator an animation shows what happens if no agent reacts: the AV follows the \
scenario's deviated trajectory, and all other agents follow the log. A scenario without a \
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

/// Finds the requested scenario: the first one with the id and the category, as far as they are given.
fn find(args: &InspectArgs) -> anyhow::Result<Scenario> {
    let wanted = Wanted {
        id: args.case_study.map(|c| c.scenario).or(args.id.as_deref()),
        category: args.category.as_deref().and_then(Deviation::from_name),
    };
    let paths = args.scenario.as_slice();
    if args.reading.is_shipped(paths) {
        if let Some(run) = args.rollout.as_deref().filter(|_| args.reading == ReadingSpec::default())
            && let Some(inputs) = of_run(run)?
        {
            return wanted.pick(formats::open_all(inputs)?, &format!("the input of {}", run.display()));
        }
        args.reading.check_absent()?;
        let scenarios = Source::shipped(usize::MAX).scenarios()?;
        return wanted.pick(scenarios, "the shipped benchmark");
    }
    let inputs = inputs_of(&args.reading, paths)?;
    let name =
        inputs.first().map(|input| args.scenario.as_ref().unwrap_or(&input.path).display().to_string());
    wanted.pick(formats::open_all(inputs)?, &name.unwrap_or_default())
}

/// Returns the scenarios that a run has read, as its specification names them; `None` if they ship with the
/// program, or it has no specification.
fn of_run(run: &Path) -> anyhow::Result<Option<Vec<Input>>> {
    let Some(spec) = RunSpec::of_run(run)? else { return Ok(None) };
    let ScenarioSpec { scenarios, reading, .. } = spec.subject.input;
    if reading.is_shipped(&scenarios) {
        return Ok(None);
    }
    let gone = || format!("name the scenarios of {}, which are no longer where it read them", run.display());
    inputs_of(&reading, &scenarios).with_context(gone).map(Some)
}

/// The scenario that is asked for.
struct Wanted<'a> {
    id: Option<&'a str>,
    category: Option<Deviation>,
}

impl Wanted<'_> {
    fn is(&self, scenario: &Scenario) -> bool {
        let category = scenario.deviation.as_ref().and_then(|d| d.category);
        self.id.is_none_or(|id| scenario.id == id) && self.category.is_none_or(|c| category == Some(c))
    }

    /// Returns the first such scenario; `place` names the input in messages.
    fn pick(
        &self,
        mut scenarios: impl Iterator<Item = Result<Scenario, FormatError>>,
        place: &str,
    ) -> anyhow::Result<Scenario> {
        if self.id.is_none() && self.category.is_none() {
            let first = scenarios.next().ok_or_else(|| anyhow!("{place} is empty"))??;
            if scenarios.next().is_some() {
                say(format_args!("note: there are more scenarios; choose one with --id"));
            }
            return Ok(first);
        }
        let (mut bad, mut ids) = (0, Vec::new());
        for scenario in scenarios {
            match scenario {
                Ok(scenario) if self.is(&scenario) => return Ok(scenario),
                Ok(scenario) => ids.push(scenario.id),
                Err(error) => {
                    bad += 1;
                    say(format_args!("warning: {error}"));
                }
            }
        }
        let damaged = if bad > 0 { format!(" ({bad} records cannot be read)") } else { String::new() };
        let category = self.category.map(|c| format!(" of category {}", c.name())).unwrap_or_default();
        match self.id {
            Some(id) => {
                bail!("{place} holds no scenario `{id}`{category}{damaged}{}", did_you_mean(id, &ids))
            }
            None => bail!("{place} holds no scenario{category}{damaged}"),
        }
    }
}

/// Parses the name of a case study.
fn case_study(name: &str) -> Result<&'static CaseStudy, String> {
    let all = || CASE_STUDIES.map(|c| c.name).join(", ");
    let meant = || did_you_mean(name, CASE_STUDIES.map(|c| c.name));
    CaseStudy::from_name(name).ok_or_else(|| format!("expected {}{}", all(), meant()))
}
