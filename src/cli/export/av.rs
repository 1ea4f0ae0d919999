//! `reactsim export av`: the trajectories of deviated AVs, for programs that simulate offline.

use std::path::PathBuf;

use anyhow::{Context, bail};
use clap::Args;
use serde_json::json;

use crate::cli::inputs::select;
use crate::cli::output::{ExitStatus, count, say};
use crate::evaluation::ScenarioSpec;
use crate::files;
use crate::scene::{AgentState, DeviatedTrack, Deviation, Scenario};

const AFTER: &str = "\
Together with `reactsim convert --history-only`, this gives others what a simulation needs and nothing of \
the recorded future: certificates, which contain motions of the other agents, are left out. The rollouts \
are scored with `reactsim score`.

Example:
  reactsim convert logs/ --history-only --out histories.parquet
  reactsim export av logs/ --deviations deviations.parquet --out avs.json";

/// Arguments of `export av`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ExportAvArgs {
    #[command(flatten)]
    input: ScenarioSpec,
    /// The JSON file of deviations to write, in the coordinates of the scenarios
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

pub(super) fn export(args: &ExportAvArgs) -> anyhow::Result<ExitStatus> {
    let selected = select(&args.input)?;
    let mut entries = Vec::new();
    let failed = selected.each(|scenario| {
        entries.extend(entry(scenario));
        anyhow::Ok(())
    })?;
    if entries.is_empty() {
        bail!(
            "no selected scenario has a deviated AV: give --deviations FILE, or make one with \
             `reactsim curate`"
        );
    }
    let number = entries.len();
    let file = json!({ "format": "reactsim-deviations-v1", "frame": "scenario", "deviations": entries });
    files::replace(&args.out, |out| out.write_all(format!("{file}\n").as_bytes()))
        .with_context(|| format!("could not write {}", args.out.display()))?;
    say(format_args!("{}: {}", args.out.display(), count(number, "deviated AV")));
    Ok(if failed > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}

/// Returns the entry of a scenario; `None` if it has no deviated AV.
fn entry(scenario: Scenario) -> Option<serde_json::Value> {
    let DeviatedTrack { category, track, .. } = scenario.deviation?;
    let column = |value: fn(&AgentState) -> f64| track.iter().map(value).collect::<Vec<f64>>();
    let mut entry = json!({
        "scenario_id": scenario.id,
        "x": column(|s| s.x),
        "y": column(|s| s.y),
        "heading": column(|s| s.heading),
    });
    if let Some(category) = category.map(Deviation::name) {
        entry["category"] = category.into();
    }
    Some(entry)
}
