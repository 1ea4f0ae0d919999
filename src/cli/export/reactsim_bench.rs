//! `reactsim export reactsim-bench`: one file of rollouts per file of the data set, with its name.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;

use crate::cli::output::{ExitStatus, count, say, write_result};
use crate::cli::progress::Progress;
use crate::evaluation::{ROLLOUTS, read_provenance, read_tally};
use crate::files;
use crate::formats::deviations;
use crate::formats::rollouts::{RolloutRecord, read, to_pickle};

const AFTER: &str = "\
Writes one file per scenario with the name of the file that its deviated AV was imported from: a dictionary \
with numpy arrays, which docs/files.md describes. The layout that the official evaluation reads is not \
published; only the names are known.

Example:
  reactsim export reactsim-bench runs/official --deviations official.parquet \\
      --simulator idm --out rollouts";

/// Arguments of `export reactsim-bench`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct ExportBenchArgs {
    /// Run folder with the imported deviations, written with --keep-rollouts
    #[arg(value_name = "RUN")]
    run: PathBuf,
    /// The deviations of the run, as written by `import reactsim-bench`
    #[arg(long, value_name = "FILE")]
    deviations: PathBuf,
    /// Simulator, if the run has several
    #[arg(long, value_name = "ID")]
    simulator: Option<String>,
    /// Folder to write; a new or empty one
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
    let names = names(args)?;
    // The files of the data set have these names.
    if fs::read_dir(&args.out).is_ok_and(|mut entries| entries.next().is_some()) {
        bail!("--out {}: the folder has files; give a new one", args.out.display());
    }
    fs::create_dir_all(&args.out).with_context(|| format!("could not write {}", args.out.display()))?;
    let progress = Progress::new();
    progress.set_total(Some(tally.entries.len()));
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
    let missing = tally.entries.len() - written;
    if missing > 0 {
        say(format_args!("warning: {} of the run without rollouts: not written", count(missing, "scenario")));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Returns the names of the imported files without ending, by the id of the scenario.
fn names(args: &ExportBenchArgs) -> anyhow::Result<BTreeMap<String, String>> {
    let file = args.deviations.display();
    let digest = files::digest(&args.deviations).with_context(|| format!("could not read {file}"))?.blake3;
    let used = read_provenance(&args.run)?.deviations;
    if used.is_none_or(|used| used.blake3 != digest) {
        bail!("--deviations {file}: it is not the file of {}; give the one of the run", args.run.display());
    }
    let stem = |name: &str| Path::new(name).file_stem().map(|stem| stem.to_string_lossy().into_owned());
    let named = |(id, record): (String, deviations::DeviationRecord)| {
        let name = record.source.as_deref().and_then(stem);
        let name = name.with_context(|| {
            format!(
                "--deviations {file}: `source` of {id} is missing; give a file of `import reactsim-bench`"
            )
        })?;
        Ok((id, name))
    };
    deviations::read(&args.deviations)?.into_iter().map(named).collect()
}

/// Writes the rollouts of a scenario, if it has a name; returns the number of files.
fn write(rollouts: &[RolloutRecord], names: &BTreeMap<String, String>, out: &Path) -> anyhow::Result<usize> {
    let Some(name) = rollouts.first().and_then(|first| names.get(&first.scenario_id)) else { return Ok(0) };
    let path = out.join(format!("{name}.pkl"));
    let content = to_pickle(rollouts).with_context(|| path.display().to_string())?;
    write_result(Some(&path), |file| file.write_all(&content))?;
    Ok(1)
}
