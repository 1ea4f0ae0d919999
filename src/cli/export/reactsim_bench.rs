//! `reactsim export reactsim-bench`: rollouts as files that are named like those of ReactSim-Bench.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use crate::cli::gallery::RunScenarioArgs;
use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, say};
use crate::evaluation::{ROLLOUTS, read_tally};
use crate::files;
use crate::formats::nuplan_names;
use crate::formats::rollouts::{RolloutRecord, read, to_pickle};

const AFTER: &str = "\
Writes one file per scenario, <map name>_<token of the scene>_<token of the current frame>.pkl: a dictionary \
with numpy arrays, which docs/files.md describes. The layout of the official files is not published; only \
their names are known.

Example:
  reactsim export reactsim-bench runs/official --scenarios official.selection.json \\
      --simulator idm --out rollouts";

/// Arguments of `export reactsim-bench`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ExportBenchArgs {
    /// Run folder, written with --keep-rollouts, on logs of nuPlan
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// Simulator, if the run has several
    #[arg(long, value_name = "ID")]
    simulator: Option<String>,
    #[command(flatten)]
    scenarios: RunScenarioArgs,
    /// Folder to write
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

pub(super) fn export(args: &ExportBenchArgs) -> anyhow::Result<ExitStatus> {
    let tally = read_tally(&args.run)?;
    let simulator = match (&args.simulator, tally.simulators.as_slice()) {
        (Some(id), all) if all.contains(id) => id,
        (None, [only]) => only,
        (_, all) => bail!("give --simulator one of those of the run: {}", all.join(", ")),
    };
    let path = args.run.join(ROLLOUTS);
    if !path.exists() {
        bail!("{} has no rollouts: repeat the run with --keep-rollouts", args.run.display());
    }
    let ids: BTreeSet<String> = tally.entries.values().map(|entry| entry.scenario.clone()).collect();
    let mut names = BTreeMap::new();
    for input in args.scenarios.inputs()? {
        names.extend(nuplan_names(&input, &ids)?);
    }
    if names.is_empty() {
        bail!("no scenario of the run is in the logs: give them, or a selection of them, with --scenarios");
    }
    fs::create_dir_all(&args.out).with_context(|| format!("could not write {}", args.out.display()))?;
    let progress = Progress::new();
    progress.set_total(Some(ids.len()));
    let (mut group, mut written): (Vec<RolloutRecord>, usize) = (Vec::new(), 0);
    for record in read(&path)? {
        let record = record?;
        if record.simulator != *simulator {
            continue;
        }
        if group.first().is_some_and(|first| first.scenario_id != record.scenario_id) {
            written += write(&group, &names, &args.out)?;
            progress.set_done(written);
            group.clear();
        }
        group.push(record);
    }
    written += write(&group, &names, &args.out)?;
    progress.end();
    say(format_args!("{}: {} of `{simulator}`", args.out.display(), count(written, "scenario")));
    let missing = ids.len() - names.len();
    if missing > 0 {
        say(format_args!(
            "warning: {} of the run are not in the logs: not written",
            count(missing, "scenario")
        ));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Writes the rollouts of a scenario, if it has a name; returns the number of files.
fn write(rollouts: &[RolloutRecord], names: &BTreeMap<String, String>, out: &Path) -> anyhow::Result<usize> {
    let Some(name) = rollouts.first().and_then(|first| names.get(&first.scenario_id)) else { return Ok(0) };
    let path = out.join(format!("{name}.pkl"));
    files::replace(&path, |file| file.write_all(&to_pickle(rollouts)))
        .with_context(|| format!("could not write {}", path.display()))?;
    Ok(1)
}
