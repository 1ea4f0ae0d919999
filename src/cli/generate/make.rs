//! `reactsim generate --preset …`: generated scenarios into a file.

use std::num::NonZeroUsize;
use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::thread;

use anyhow::{Context, bail};
use clap::Args;
use clap::builder::PossibleValuesParser;

use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, say, stop_on_interrupt};
use crate::curation::driver::CurationObserver;
use crate::formats::native::Writer;
use crate::generation::{Ending, GenerationSettings, Generator, Preset, in_order};

/// Arguments of `generate` itself.
#[derive(Debug, Args)]
pub(super) struct MakeArgs {
    /// What for: a benchmark with deviated AVs, or logs to train on
    #[arg(long, required = true, value_name = "PRESET", value_parser = presets())]
    preset: Option<String>,
    /// Scenarios to write
    #[arg(long, required = true, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    count: Option<u32>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// The file to write (Parquet)
    #[arg(long, required = true, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Map types, separated by commas [default: all]; `list maps` names them
    #[arg(long, value_delimiter = ',', value_name = "IDS")]
    maps: Vec<String>,
    /// Traffic volume as a multiple of what is usual [default: drawn for each scenario]
    #[arg(long, value_name = "D", allow_negative_numbers = true)]
    density: Option<f64>,
    /// Threads [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
}

fn presets() -> PossibleValuesParser {
    PossibleValuesParser::new(Preset::ALL.iter().map(|p| p.name()))
}

impl MakeArgs {
    fn settings(&self) -> anyhow::Result<GenerationSettings> {
        let preset = self.preset.as_deref().and_then(Preset::from_name).context("name a --preset")?;
        Ok(GenerationSettings { preset, seed: self.seed, maps: self.maps.clone(), density: self.density })
    }
}

pub(super) fn make(args: &MakeArgs) -> anyhow::Result<ExitStatus> {
    // Everything that can be wrong is found before the first scenario.
    let out = args.out.as_deref().context("name the file to write with --out")?;
    let wanted = args.count.context("say with --count how many")?;
    let settings = args.settings()?;
    let generator = Generator::new(settings.clone())?;
    let mut writer = Writer::create(out)?;
    let jobs =
        args.jobs.map_or_else(|| thread::available_parallelism().map_or(1, NonZeroUsize::get), usize::from);
    let stop = stop_on_interrupt("writing what is finished")?;
    let progress = Progress::new();
    let mut written = 0;
    let ending = match settings.preset {
        Preset::Train => train(&generator, wanted, jobs, &stop, &progress, &mut writer, &mut written),
        Preset::Bench => bail!("the preset bench is not there yet"),
    };
    progress.end();
    let ending = ending?;
    if written == 0 {
        bail!("interrupted before the first scenario: nothing is written");
    }
    writer.finish()?;
    if ending == Ending::Stopped {
        say(format_args!("interrupted: the file holds the first {}", count(written, "scenario")));
        return Ok(ExitStatus::Interrupted);
    }
    Ok(ExitStatus::Done)
}

/// The scenarios as they are.
fn train(
    generator: &Generator,
    wanted: u32,
    jobs: usize,
    stop: &AtomicBool,
    progress: &Progress,
    writer: &mut Writer,
    written: &mut usize,
) -> anyhow::Result<Ending> {
    let make = |_: &usize, number| generator.scenario(number);
    in_order(u64::from(wanted), jobs, stop, written, make, |written, _, scenario| {
        writer.write(&scenario?)?;
        *written += 1;
        CurationObserver::scenario_done(progress, *written);
        Ok(ControlFlow::Continue(()))
    })
}
