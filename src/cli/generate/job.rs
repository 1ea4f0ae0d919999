//! What is generated, and how it ends.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;

use super::manifest::manifest;
use crate::cli::output::{ExitStatus, count, say, say_part, write_result};
use crate::cli::partition::PartitionArg;
use crate::cli::progress::Progress;
use crate::cli::subject::JobsArg;
use crate::curation::driver::CurationObserver;
use crate::formats::{FormatError, FutureChoice};
use crate::generation::{Ending, GenerationSettings, Generator, Preset, in_order};
use crate::scene::{Length, Scenario};

const AFTER: &str = "\
The preset train writes scenarios as they are generated. The preset sensed makes traffic with the \
speeds of recordings, and adds the noise and the gaps of sensors. The preset bench curates \
scenarios and keeps those with a deviated AV until the quotas of all categories and map types are \
filled. It writes the candidates, as `curate` does, to a second file next to FILE.

Examples:
  reactsim generate --preset bench --count 150 --out bench.parquet
  reactsim run bench.parquet
  reactsim curate stats bench.deviations.parquet
  reactsim generate --preset train --count 50 --future 20s --out long.parquet

The manifest entry of the files is printed to stdout (TOML): command, settings and digests.";

/// Arguments of `generate`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(in crate::cli) struct GenerateArgs {
    /// Purpose: a benchmark with deviated AVs, or logs to train on
    #[arg(long, value_name = "PRESET",
          value_parser = PossibleValuesParser::new(Preset::ALL.iter().map(|preset| preset.name())))]
    preset: String,
    /// Scenarios to write
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    pub(super) count: u32,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// File to write (Parquet)
    #[arg(long, value_name = "FILE")]
    pub(super) out: PathBuf,
    /// Map types, separated by commas [default: all but those drawn only if requested, such as `overpass`];
    /// `list maps` names them
    #[arg(long, value_delimiter = ',', value_name = "IDS")]
    maps: Vec<String>,
    /// Traffic volume as a multiple of the usual one [default: drawn for each scenario]
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    density: Option<f64>,
    /// Frames up to and including the current one, 2 to 100 [default: 11]
    #[arg(long, value_name = "N")]
    history: Option<usize>,
    /// Time after the current frame: seconds (`20s`) or steps of 0.1 s (`200`); the AV is on the map all the
    /// time [default: 8s]
    #[arg(long, value_name = "TIME")]
    future: Option<FutureChoice>,
    #[command(flatten)]
    pub(super) jobs: JobsArg,
    #[command(flatten)]
    pub(super) partition: PartitionArg,
}

impl GenerateArgs {
    pub(super) fn settings(&self) -> anyhow::Result<GenerationSettings> {
        let preset = Preset::from_name(&self.preset).context("give a --preset")?;
        let future = match self.future {
            None => Length::BENCHMARK.future,
            Some(FutureChoice::Steps(steps)) => steps,
            Some(FutureChoice::Log) => bail!("--future log: nothing is recorded; give seconds, such as 20s"),
        };
        let length = Length { history: self.history.unwrap_or(Length::BENCHMARK.history), future };
        let (seed, maps, density) = (self.seed, self.maps.clone(), self.density);
        Ok(GenerationSettings { preset, seed, maps, density, length })
    }
}

/// A generation in this process.
#[derive(Clone, Copy)]
pub(super) struct Job<'a> {
    pub(super) settings: &'a GenerationSettings,
    /// Number of scenarios to write.
    pub(super) wanted: u32,
    /// Number of threads.
    pub(super) jobs: usize,
    pub(super) out: &'a Path,
    pub(super) progress: &'a Progress,
    pub(super) stop: &'a AtomicBool,
}

/// Files of one generation and how it went.
pub(super) struct GeneratedFiles {
    /// Paths; the first one is `--out`, or the part of it that an interrupted command has finished.
    pub(super) files: Vec<PathBuf>,
    /// Number of scenarios in them.
    pub(super) written: usize,
    /// Number of scenarios that could not be generated.
    pub(super) failed: usize,
    /// Whether quotas of a benchmark could not be filled.
    pub(super) unfilled: bool,
    /// Whether the user interrupted the generation.
    pub(super) interrupted: bool,
}

/// Writes the scenarios of these numbers, in order. Those that cannot be generated are reported and left out.
/// Returns how it ended, and how many were written and how many failed.
pub(super) fn write_all(
    job: Job<'_>,
    generator: &Generator,
    numbers: Range<u64>,
    mut write: impl FnMut(&Scenario) -> Result<(), FormatError>,
) -> Result<(Ending, usize, usize), FormatError> {
    let (mut written, mut failed) = (0, 0);
    let make = |(): &(), number| generator.scenario(number);
    let ending = in_order(numbers, job.jobs, job.stop, &mut (), make, |(), scenario| {
        match scenario {
            Ok(scenario) => {
                write(&scenario)?;
                written += 1;
            }
            Err(error) => {
                job.progress.failed(&error.to_string());
                failed += 1;
            }
        }
        job.progress.scenario_done(written + failed);
        Ok::<_, FormatError>(ControlFlow::Continue(()))
    })?;
    Ok((ending, written, failed))
}

/// Prints the manifest entry of what was generated.
pub(super) fn finish(args: &GenerateArgs, generated: &GeneratedFiles) -> anyhow::Result<ExitStatus> {
    let GeneratedFiles { files, written, failed, unfilled, interrupted } = generated;
    if *written == 0 {
        bail!("no scenario was generated, and no file was written");
    }
    if *interrupted {
        say_part(files, &args.out, &count(*written, "scenario"));
        return Ok(ExitStatus::Interrupted);
    }
    let entry = manifest(&args.settings()?, args.count, files)?;
    write_result(None, |out| out.write_all(entry.as_bytes()))?;
    if *failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the file"));
    }
    Ok(if *failed > 0 || *unfilled { ExitStatus::SomeFailed } else { ExitStatus::Done })
}
