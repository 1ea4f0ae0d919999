//! `reactsim train vocabulary`: motion tokens from scenarios.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

use anyhow::bail;
use clap::{Args, ValueEnum};

use super::reader::Reader;
use super::tensor_file::TensorFile;
use super::vocabulary_manifest::Entry;
use crate::cli::inputs::find_inputs;
use crate::cli::output::{ExitStatus, nothing, say, stop_on_interrupt, write_result};
use crate::cli::progress::Progress;
use crate::models::ntp::tokens::{
    KDisks, Kinematic, MapVocabularyBuilder, MatchingErrors, Segments, Tokenizer, TrajTok,
};

const AFTER: &str = "\
k-disks draws recorded motions that are not close to each other. trajtok creates a token for \
every cell in which motions end. kinematic is a grid of speeds and curvatures; it needs no \
scenarios, and those given only serve to measure its fit.

Examples:
  reactsim generate --preset train --count 200 --out train.parquet
  reactsim train vocabulary train.parquet --method k-disks --out vocab.safetensors

The manifest entry of the files is printed to stdout (TOML). Its errors are distances between the \
corners of tokenised and recorded boxes in metres: mean, median and 99th percentile.";

/// Arguments of `train vocabulary`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VocabularyArgs {
    /// Files or folders of scenarios
    #[arg(value_name = "SCENARIOS", required_if_eq_any([("method", "k-disks"), ("method", "trajtok")]))]
    scenarios: Vec<PathBuf>,
    /// Method that creates the tokens
    #[arg(long, value_enum)]
    method: Method,
    /// File of the vocabulary to write (safetensors)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also write a vocabulary of 5 m map segments to this file
    #[arg(long, value_name = "FILE")]
    map_out: Option<PathBuf>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Only the first N scenarios, over all files [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Tokens per class (k-disks) [default: 2048]
    #[arg(long, value_name = "N")]
    tokens: Option<NonZeroUsize>,
    /// Distance below which motions share a token, metres (k-disks) [default: vehicles 0.05,
    /// pedestrians 0.025, cyclists 0.0125]
    #[arg(long, value_name = "M")]
    tolerance: Option<f64>,
    /// Add the mirror image of every token (k-disks; the other methods are always symmetric)
    #[arg(long)]
    symmetric: bool,
    /// Motions per class to keep in memory
    #[arg(long, default_value = "204800", value_name = "N")]
    segments: NonZeroUsize,
    /// Add kinematic tokens far from all others, for classes with few recorded motions
    #[arg(long)]
    fill: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Means of recorded motions around drawn ones (SMART, CATK)
    KDisks,
    /// Grid of the positions where motions end (TrajTok)
    Trajtok,
    /// Grid of speeds and curvatures
    Kinematic,
}

/// Number of tokens of a map vocabulary.
const MAP_TOKENS: usize = 1024;
/// Distance in metres below which map segments share a token.
const MAP_TOLERANCE: f64 = 0.05;
/// Number of map segments kept in memory to choose from.
const MAP_SEGMENTS: usize = 50_000;
/// Number of scenarios on which the errors are measured.
const MEASURED_SCENARIOS: usize = 200;

impl VocabularyArgs {
    fn tokenizer(&self) -> anyhow::Result<Box<dyn Tokenizer>> {
        let for_k_disks = [
            ("--tokens", self.tokens.is_some()),
            ("--tolerance", self.tolerance.is_some()),
            ("--symmetric", self.symmetric),
        ];
        if let Some((flag, _)) =
            for_k_disks.into_iter().find(|(_, given)| *given && self.method != Method::KDisks)
        {
            bail!("{flag} is for --method k-disks only");
        }
        Ok(match self.method {
            Method::KDisks => {
                let default = KDisks::default();
                Box::new(KDisks {
                    tokens: self.tokens.map_or(default.tokens, NonZeroUsize::get),
                    tolerance: self.tolerance.map_or(default.tolerance, |t| [t; 3]),
                    symmetric: self.symmetric,
                    ..default
                })
            }
            Method::Trajtok => Box::new(TrajTok::default()),
            Method::Kinematic => Box::new(Kinematic::default()),
        })
    }
}

pub(super) fn vocabulary(args: &VocabularyArgs) -> anyhow::Result<ExitStatus> {
    // Report every input error before the first scenario.
    let tokenizer = args.tokenizer()?;
    let inputs = if args.scenarios.is_empty() { Vec::new() } else { find_inputs(&args.scenarios)? };
    if inputs.is_empty() && args.map_out.is_some() {
        bail!("a map vocabulary (--map-out) is built from scenarios: give some");
    }
    let out = TensorFile::create(&args.out)?;
    let map_out = args.map_out.as_deref().map(TensorFile::create).transpose()?;
    let stop = stop_on_interrupt("nothing is written")?;
    let progress = Progress::new();
    let mut reader = Reader::new(&inputs, args.limit, &progress, &stop);
    let mut segments = Segments::new(args.segments.get(), args.seed);
    let mut map = map_out.is_some().then(|| MapVocabularyBuilder::new(MAP_SEGMENTS, args.seed));
    let read = reader.each(usize::MAX, |scenario| {
        segments.add(scenario);
        if let Some(map) = &mut map {
            map.add(scenario);
        }
    });
    if !inputs.is_empty() && read == 0 && !stop.load(Ordering::Relaxed) {
        progress.end();
        return Err(nothing("no scenario could be read"));
    }
    let vocabulary = tokenizer.build_from(&segments, args.fill);
    let mut errors = MatchingErrors::default();
    if let Ok(vocabulary) = &vocabulary {
        reader.reports_failures = false;
        reader.each(MEASURED_SCENARIOS, |scenario| errors.add(vocabulary, scenario));
    }
    progress.end();
    if stop.load(Ordering::Relaxed) {
        say(format_args!("interrupted: nothing is written"));
        return Ok(ExitStatus::Interrupted);
    }
    let vocabulary = vocabulary?;
    let written = out.finish(&vocabulary.write()?)?;
    let mut entries = vec![Entry::of_vocabulary(written, &vocabulary, &errors)];
    if let (Some(map), Some(out)) = (map, map_out) {
        let map = map.build(MAP_TOKENS, MAP_TOLERANCE)?;
        let written = out.finish(&map.write()?)?;
        entries.push(Entry::of_map_vocabulary(written, &map));
    }
    let text = toml::to_string(&BTreeMap::from([("vocabulary", entries)]))?;
    write_result(None, |out| out.write_all(text.as_bytes()))?;
    Ok(reader.status("the vocabulary is built from the others"))
}
