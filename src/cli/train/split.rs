//! `reactsim train split`: divides scenarios into parts.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::atomic::Ordering;

use anyhow::{anyhow, bail};
use clap::Args;

use super::reader::Reader;
use crate::cli::inputs::find_inputs;
use crate::cli::output::{ExitStatus, count, is_same, lock_folder, say, stop_on_interrupt, write_result};
use crate::cli::progress::Progress;
use crate::formats::native::Writer;
use crate::scene::Scenario;
use crate::training::{leading_bits, unit_interval};

const AFTER: &str = "\
The part of a scenario depends only on its content and the seed: it stays the same when other \
scenarios are added, and scenarios with the same content are in the same part.

Example:
  reactsim train split logs/ --part train=0.9 --part val=0.1 --out parts
  reactsim train ntp-reactive parts/train.parquet --closed-loop parts/val.parquet --out training";

/// Arguments of `train split`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct SplitArgs {
    /// Files or folders of scenarios
    #[arg(required = true, value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// Name of a part and its share; shares add up to 1. Give at least two
    #[arg(long = "part", required = true, value_name = "NAME=SHARE")]
    parts: Vec<Part>,
    /// Folder to write: a file NAME.parquet for every part
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
}

/// A part and its share of the scenarios.
#[derive(Clone, Debug)]
struct Part {
    name: String,
    share: f64,
}

impl FromStr for Part {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let refuse = || "write NAME=SHARE, such as train=0.9, with a share above 0, below 1".to_owned();
        let (name, share) = text.split_once('=').ok_or_else(refuse)?;
        let share: f64 = share.parse().map_err(|_| refuse())?;
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || !name.chars().all(is_plain) {
            return Err(format!("`{name}` is not a name: use letters, digits, - and _"));
        }
        if share > 0.0 && share < 1.0 { Ok(Self { name: name.to_owned(), share }) } else { Err(refuse()) }
    }
}

pub(super) fn split(args: &SplitArgs) -> anyhow::Result<ExitStatus> {
    check(&args.parts)?;
    let inputs = find_inputs(&args.scenarios)?;
    let _lock = lock_folder(&args.out)?;
    let path = |part: &Part| args.out.join(format!("{}.parquet", part.name));
    let is_input = |path: &PathBuf| inputs.iter().any(|input| is_same(&input.path, path));
    if let Some(same) = args.parts.iter().map(path).find(is_input) {
        bail!("{} is both input and output; choose another --out", same.display());
    }
    let create = |part: &Part| Writer::create(path(part));
    let mut writers = args.parts.iter().map(create).collect::<Result<Vec<_>, _>>()?;
    let mut counts = vec![0_usize; writers.len()];
    let (mut ids, mut repeated, mut failure) = (BTreeSet::new(), 0, None);
    let stop = stop_on_interrupt("nothing is written")?;
    let progress = Progress::new();
    let mut reader = Reader::new(&inputs, None, &progress, &stop);
    reader.each(usize::MAX, |scenario| {
        if !ids.insert(scenario.id.clone()) {
            repeated += 1;
            return;
        }
        let part = part_of(scenario, &args.parts, args.seed);
        match writers[part].write(scenario) {
            Ok(()) => counts[part] += 1,
            Err(error) => {
                // The other scenarios could not be written either.
                failure = Some(error);
                stop.store(true, Ordering::Relaxed);
            }
        }
    });
    progress.end();
    if let Some(error) = failure {
        return Err(anyhow!(error));
    }
    if stop.load(Ordering::Relaxed) {
        say(format_args!("interrupted: nothing is written"));
        return Ok(ExitStatus::Interrupted);
    }
    if let Some(empty) = counts.iter().position(|count| *count == 0) {
        let (name, all) = (&args.parts[empty].name, counts.iter().sum());
        bail!("the part `{name}` of {} would be empty: nothing is written", count(all, "scenario"));
    }
    for writer in writers {
        writer.finish()?;
    }
    write_result(None, |out| {
        for (part, scenarios) in args.parts.iter().zip(&counts) {
            writeln!(out, "{}.parquet: {}", part.name, count(*scenarios, "scenario"))?;
        }
        Ok(())
    })?;
    if repeated > 0 {
        say(format_args!("warning: {} left out: earlier ones have their ids", count(repeated, "scenario")));
    }
    Ok(if reader.failed > 0 || repeated > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done })
}

fn check(parts: &[Part]) -> anyhow::Result<()> {
    if parts.len() < 2 {
        bail!("--part: give at least two parts, such as --part train=0.9 --part val=0.1");
    }
    let sum: f64 = parts.iter().map(|part| part.share).sum();
    if (sum - 1.0).abs() > 1e-6 {
        bail!("--part: the shares add up to {sum}, expected 1");
    }
    Ok(())
}

/// Returns the number of the part that a scenario belongs to, by a hash of seed and content.
fn part_of(scenario: &Scenario, parts: &[Part], seed: u64) -> usize {
    let mut hasher = blake3::Hasher::new();
    hasher.update(b"reactsim-split").update(&seed.to_le_bytes()).update(scenario.digest().as_bytes());
    let mut left = unit_interval(leading_bits(&hasher.finalize()));
    for (number, part) in parts.iter().enumerate() {
        left -= part.share;
        if left < 0.0 {
            return number;
        }
    }
    parts.len() - 1
}
