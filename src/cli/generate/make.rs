//! `reactsim generate --preset …`: writes generated scenarios to a file.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use anyhow::{Context, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;

use super::AFTER;
use super::bench::bench;
use super::files::GeneratedFiles;
use super::manifest::Manifest;
use super::partition;
use crate::cli::partition::PartitionArg;
use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, say, say_part, stop_on_interrupt, write_result};
use crate::curation::driver::CurationObserver;
use crate::formats::FormatError;
use crate::formats::native::Writer;
use crate::generation::{Ending, GenerationSettings, Generator, Preset, in_order};
use crate::work::available_threads;

/// Arguments of `generate`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(in crate::cli) struct GenerateArgs {
    /// Purpose: a benchmark with deviated AVs, or logs to train on
    #[arg(long, value_name = "PRESET", value_parser = presets())]
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
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    #[command(flatten)]
    partition: PartitionArg,
}

fn presets() -> PossibleValuesParser {
    PossibleValuesParser::new(Preset::ALL.iter().map(|p| p.name()))
}

impl GenerateArgs {
    pub(super) fn settings(&self) -> anyhow::Result<GenerationSettings> {
        let preset = Preset::from_name(&self.preset).context("give a --preset")?;
        Ok(GenerationSettings { preset, seed: self.seed, maps: self.maps.clone(), density: self.density })
    }

    /// Returns the number of threads.
    pub(super) fn jobs(&self) -> usize {
        self.jobs.map_or_else(available_threads, usize::from)
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

pub(in crate::cli) fn generate(args: &GenerateArgs) -> anyhow::Result<ExitStatus> {
    if let Some(partition) = args.partition.partition {
        return partition::generate(args, partition);
    }
    let (out, wanted, settings, jobs) = (args.out.as_path(), args.count, &args.settings()?, args.jobs());
    let stop = stop_on_interrupt("writing what is finished")?;
    let progress = Progress::new();
    let job = Job { settings, wanted, jobs, out, progress: &progress, stop: &stop };
    let generated = match settings.preset {
        Preset::Train | Preset::Sensed => train(job),
        Preset::Bench => bench(job, (0, std::iter::empty())),
    };
    progress.end();
    finish(args, &generated?)
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
    let files: Vec<&Path> = files.iter().map(PathBuf::as_path).collect();
    let entry = Manifest::new(&args.settings()?, args.count, &files)?.text()?;
    write_result(None, |out| out.write_all(entry.as_bytes()))?;
    if *failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the file"));
    }
    Ok(if *failed > 0 || *unfilled { ExitStatus::SomeFailed } else { ExitStatus::Done })
}

/// Writes scenarios 0 to below `wanted` as generated. Scenarios that cannot be generated are
/// reported and left out.
fn train(job: Job<'_>) -> anyhow::Result<GeneratedFiles> {
    let Job { settings, wanted, jobs, out, progress, stop } = job;
    // Report every input error before the first scenario.
    let generator = Generator::new(settings.clone())?;
    let mut writer = Writer::create(out)?;
    progress.set_total(Some(wanted as usize));
    let mut counts = (0, 0);
    let generate = |_: &(usize, usize), number| generator.scenario(number);
    let ending = in_order(u64::from(wanted), jobs, stop, &mut counts, generate, |counts, _, scenario| {
        match scenario {
            Ok(scenario) => {
                writer.write(&scenario)?;
                counts.0 += 1;
            }
            Err(error) => {
                progress.failed(&error.to_string());
                counts.1 += 1;
            }
        }
        progress.scenario_done(counts.0 + counts.1);
        Ok::<_, FormatError>(ControlFlow::Continue(()))
    })?;
    let (written, failed) = counts;
    let interrupted = ending == Ending::Stopped;
    let mut file = out.to_owned();
    if written > 0 && interrupted {
        file = writer.finish_part()?;
    } else if written > 0 {
        writer.finish()?;
    }
    Ok(GeneratedFiles { files: vec![file], written, failed, unfilled: false, interrupted })
}
