//! `reactsim train intentions`: where agents are after eight seconds.

use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::bail;
use clap::Args;
use serde::Serialize;

use super::new_file::NewFile;
use super::reader::Reader;
use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, find_inputs, say, stop_on_interrupt, write_result};
use crate::models::ntp::tokens::Class;
use crate::models::qp_regression::EndPoints;

const AFTER: &str = "\
Points are means of recorded places, found by k-means, in the frame of an agent; left is the mirror
image of right. Who stands does not count: he has a point of his own.

  reactsim train intentions train.parquet --out intentions.safetensors
  reactsim train qp-regression train.parquet --intentions intentions.safetensors --out regression

The result on stdout says what was made (TOML).";

/// Arguments of `train intentions`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct IntentionsArgs {
    /// Files or folders of scenarios
    #[arg(required = true, value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// The points to write (safetensors)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Points of every class
    #[arg(long, default_value = "16", value_name = "N")]
    points: NonZeroUsize,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Take the first N records of every file only
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Places of every class to keep in memory
    #[arg(long, default_value = "50000", value_name = "N")]
    places: NonZeroUsize,
}

/// What was made.
#[derive(Serialize)]
struct Made {
    file: String,
    bytes: u64,
    blake3: String,
    seed: u64,
    scenarios: u64,
    data: String,
    class: Vec<OfClass>,
}

#[derive(Serialize)]
struct OfClass {
    class: &'static str,
    /// Different places that were recorded.
    places: u64,
    points: Vec<[f64; 2]>,
}

pub(super) fn intentions(args: &IntentionsArgs) -> anyhow::Result<ExitStatus> {
    // Everything that can be wrong is found before the first scenario.
    let inputs = find_inputs(&args.scenarios)?;
    let out = NewFile::create(&args.out)?;
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
        bail!("no scenario could be read: see the warnings above");
    }
    let made = ends.build(args.points.get())?;
    let written = out.finish(&made.write()?)?;
    let short = |v: f64| (v * 1e3).round() / 1e3;
    let provenance = made.provenance();
    let of_class = |class: Class| OfClass {
        class: class.name(),
        places: ends.seen(class),
        points: made.of(class).iter().map(|p| [short(p.x), short(p.y)]).collect(),
    };
    let result = Made {
        file: written.name,
        bytes: written.bytes,
        blake3: written.blake3,
        seed: provenance.seed,
        scenarios: provenance.scenarios,
        data: provenance.data.clone(),
        class: Class::ALL.into_iter().map(of_class).collect(),
    };
    let text = toml::to_string(&result)?;
    write_result(None, |out| out.write_all(text.as_bytes()))?;
    if reader.failed > 0 {
        let failed = count(reader.failed, "scenario");
        say(format_args!("warning: {failed} failed; the points are made of the others"));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}
