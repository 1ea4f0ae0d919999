//! `reactsim train intentions`: intention points, positions of agents after eight seconds.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use clap::Args;
use serde::Serialize;

use super::reader::Reader;
use super::tensor_file::TensorFile;
use crate::cli::inputs::find_inputs;
use crate::cli::output::{ExitStatus, nothing, say, stop_on_interrupt, write_result};
use crate::cli::progress::Progress;
use crate::models::learning::EndPoints;
use crate::models::perception::Class;

const AFTER: &str = "\
Points are k-means centres of recorded positions in the frame of an agent; left mirrors right. \
Standing agents are left out: they have a point of their own.

Examples:
  reactsim train intentions train.parquet --out intentions.safetensors
  reactsim train qp-regression train.parquet --input intentions=intentions.safetensors --out mtr

The manifest entry of the file is printed to stdout (TOML).";

/// Arguments of `train intentions`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct IntentionsArgs {
    /// Files or folders of scenarios
    #[arg(required = true, value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// File of points to write (safetensors)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Points per class
    #[arg(long, default_value = "16", value_name = "N")]
    points: NonZeroUsize,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Only the first N scenarios, over all files [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Positions per class to keep in memory
    #[arg(long, default_value = "50000", value_name = "N")]
    places: NonZeroUsize,
}

/// Manifest entry of a file of intention points.
#[derive(Serialize)]
struct ManifestEntry {
    file: String,
    bytes: u64,
    blake3: String,
    seed: u64,
    scenarios: u64,
    data: String,
    class: Vec<ClassEntry>,
}

/// Intention points of one class of agents.
#[derive(Serialize)]
struct ClassEntry {
    class: &'static str,
    /// Number of distinct recorded positions.
    places: u64,
    points: Vec<[f64; 2]>,
}

pub(super) fn intentions(args: &IntentionsArgs) -> anyhow::Result<ExitStatus> {
    // Report every input error before the first scenario.
    let inputs = find_inputs(&args.scenarios)?;
    let out = TensorFile::create(&args.out)?;
    let stop = stop_on_interrupt("nothing is written")?;
    let progress = Progress::new();
    let mut reader = Reader::new(&inputs, args.limit, &progress, &stop);
    let mut ends = EndPoints::new(args.places.get(), args.seed);
    let read = reader.each(usize::MAX, |scenario| ends.add(scenario));
    progress.end();
    if stop.load(Ordering::Relaxed) {
        say(format_args!("interrupted: nothing is written"));
        return Ok(ExitStatus::Interrupted);
    }
    if read == 0 {
        return Err(nothing("no scenario could be read"));
    }
    let intentions = ends.build(args.points.get())?;
    let written = out.finish(&intentions.write()?)?;
    let short = |v: f64| (v * 1e3).round() / 1e3;
    let provenance = intentions.provenance();
    let class_entry = |class: Class| ClassEntry {
        class: class.name(),
        places: ends.seen(class),
        points: intentions.of(class).iter().map(|p| [short(p.x), short(p.y)]).collect(),
    };
    let entry = ManifestEntry {
        file: written.name,
        bytes: written.bytes,
        blake3: written.blake3,
        seed: provenance.seed,
        scenarios: provenance.scenarios,
        data: provenance.data.clone(),
        class: Class::ALL.into_iter().map(class_entry).collect(),
    };
    let text = toml::to_string(&entry)?;
    write_result(None, |out| out.write_all(text.as_bytes()))?;
    Ok(reader.status("the points are computed from the others"))
}
