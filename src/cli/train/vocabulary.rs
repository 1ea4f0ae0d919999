//! `reactsim train vocabulary`: motion tokens from scenarios.

use std::fs::{self, File};
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

use anyhow::{Context, bail};
use clap::{Args, ValueEnum};
use serde::Serialize;

use crate::cli::progress::Progress;
use crate::cli::{ExitStatus, count, find_inputs, say, stop_on_interrupt, write_result};
use crate::curation::driver::CurationObserver;
use crate::evaluation::FileRecord;
use crate::formats::Input;
use crate::models::ntp::tokens::{
    Class, KDisks, Kinematic, MapVocabularyBuilder, MatchingErrors, Provenance, Segments, Tokenizer, TrajTok,
    Vocabulary,
};
use crate::scene::Scenario;

const AFTER: &str = "\
k-disks draws recorded motions that are not near one another, trajtok makes a token for every place
where motions end, kinematic is a grid of speeds and curvatures and needs no scenarios: those that
are given only tell how well it fits.

  reactsim generate --preset train --count 200 --out train.parquet
  reactsim train vocabulary train.parquet --method k-disks --out vocab.safetensors

The result on stdout says what was made (TOML), with the mean distance of the corners of tokenised
from recorded boxes, in metres.";

/// Arguments of `train vocabulary`.
#[derive(Debug, Args)]
#[command(after_help = AFTER)]
pub(super) struct VocabularyArgs {
    /// Files or folders of scenarios
    #[arg(value_name = "SCENARIOS", required_if_eq_any([("method", "k-disks"), ("method", "trajtok")]))]
    scenarios: Vec<PathBuf>,
    /// How tokens are made
    #[arg(long, value_enum)]
    method: Method,
    /// The vocabulary to write (safetensors)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Write a vocabulary of 5 m pieces of the map to this file too
    #[arg(long, value_name = "FILE")]
    map_out: Option<PathBuf>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0, value_name = "S")]
    seed: u64,
    /// Take the first N records of every file only
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Tokens of every class (k-disks) [default: 2048]
    #[arg(long, value_name = "N")]
    tokens: Option<NonZeroUsize>,
    /// Nearer motions are one token, metres (k-disks) [default: 0.05]
    #[arg(long, value_name = "M")]
    tolerance: Option<f64>,
    /// Every token comes with its mirror image (k-disks; the others always are symmetric)
    #[arg(long)]
    symmetric: bool,
    /// Motions of every class to keep in memory
    #[arg(long, default_value = "204800", value_name = "N")]
    segments: NonZeroUsize,
    /// Take kinematic tokens for classes of which too little was recorded
    #[arg(long)]
    fill: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Method {
    /// Means of recorded motions about ones that are drawn (SMART, CATK)
    KDisks,
    /// A grid of the places where motions end (TrajTok)
    Trajtok,
    /// A grid of speeds and curvatures
    Kinematic,
}

/// Curves of a vocabulary of the map, how near two are one (metres), and how many are kept to choose from.
const MAP: (usize, f64, usize) = (1024, 0.05, 200_000);
/// Scenarios on which the errors are measured.
const MEASURED: usize = 200;

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
    // Everything that can be wrong is found before the first scenario.
    let tokenizer = args.tokenizer()?;
    let inputs = if args.scenarios.is_empty() { Vec::new() } else { find_inputs(&args.scenarios)? };
    if inputs.is_empty() && args.map_out.is_some() {
        bail!("a vocabulary of the map (--map-out) is made of scenarios: name some");
    }
    let out = NewFile::create(&args.out)?;
    let map_out = args.map_out.as_deref().map(NewFile::create).transpose()?;
    let stop = stop_on_interrupt("nothing is written")?;
    let progress = Progress::new();
    let mut reader =
        Reader { inputs: &inputs, limit: args.limit, progress: &progress, stop: &stop, failed: 0 };
    let mut segments = Segments::new(args.segments.get(), args.seed);
    let mut map = map_out.is_some().then(|| MapVocabularyBuilder::new(MAP.2, args.seed));
    let read = reader.each(usize::MAX, |scenario| {
        segments.add(scenario);
        if let Some(map) = &mut map {
            map.add(scenario);
        }
    });
    let failed = reader.failed;
    if !inputs.is_empty() && read == 0 && !stop.load(Ordering::Relaxed) {
        progress.end();
        bail!("no scenario could be read: see the warnings above");
    }
    let made = tokenizer.build_from(&segments, args.fill);
    let mut errors = MatchingErrors::default();
    if let Ok(vocabulary) = &made {
        reader.each(MEASURED, |scenario| errors.add(vocabulary, scenario));
    }
    progress.end();
    if stop.load(Ordering::Relaxed) {
        say(format_args!("interrupted: nothing is written"));
        return Ok(ExitStatus::Interrupted);
    }
    let vocabulary = made?;
    let written = out.finish(&vocabulary.write()?)?;
    let mut entries = vec![Entry::of_vocabulary(written, &vocabulary, &errors)];
    if let (Some(map), Some(out)) = (map, map_out) {
        let map = map.build(MAP.0, MAP.1)?;
        let written = out.finish(&map.write()?)?;
        let tokens = vec![Tokens { class: "map", tokens: map.tokens(), error_mean: None, error_p99: None }];
        entries.push(Entry::new(written, map.provenance(), tokens));
    }
    let text = toml::to_string(&Manifest { vocabulary: entries })?;
    write_result(None, |out| out.write_all(text.as_bytes()))?;
    if failed > 0 {
        say(format_args!(
            "warning: {} failed; the vocabulary is made of the others",
            count(failed, "scenario")
        ));
        return Ok(ExitStatus::SomeFailed);
    }
    Ok(ExitStatus::Done)
}

/// Reads scenarios from the first on.
struct Reader<'a> {
    inputs: &'a [Input],
    limit: Option<NonZeroUsize>,
    progress: &'a Progress,
    stop: &'a AtomicBool,
    /// Scenarios and files that could not be read, in all passes.
    failed: usize,
}

impl Reader<'_> {
    /// Shows the first good scenarios, at most so many, and says how many there were.
    fn each(&mut self, most: usize, mut show: impl FnMut(&Scenario)) -> usize {
        let (mut shown, limit) = (0, self.limit.map_or(usize::MAX, NonZeroUsize::get));
        for input in self.inputs {
            let scenarios = match input.format.open(&input.path) {
                Ok(scenarios) => scenarios,
                Err(error) => {
                    self.fail(&error.to_string());
                    continue;
                }
            };
            for scenario in scenarios.take(limit) {
                if shown >= most || self.stop.load(Ordering::Relaxed) {
                    return shown;
                }
                match scenario {
                    Ok(scenario) => {
                        show(&scenario);
                        shown += 1;
                        self.progress.scenario_done(shown);
                    }
                    Err(error) => self.fail(&error.to_string()),
                }
            }
        }
        shown
    }

    fn fail(&mut self, error: &str) {
        self.progress.failed(error);
        self.failed += 1;
    }
}

/// A file that gets its name when it is whole; dropped before, it is removed.
struct NewFile {
    path: PathBuf,
    partial: PathBuf,
    file: File,
}

impl NewFile {
    fn create(path: &Path) -> anyhow::Result<Self> {
        let name = || format!("could not write {}", path.display());
        if path.exists() && !path.is_file() {
            bail!("{}: it is there and no regular file; choose another name", name());
        }
        let file_name = path.file_name().with_context(name)?;
        let partial = path.with_file_name(format!(".{}.{}.partial", file_name.display(), std::process::id()));
        let file = File::create(&partial).with_context(name)?;
        Ok(Self { path: path.to_owned(), partial, file })
    }

    fn finish(mut self, bytes: &[u8]) -> anyhow::Result<FileRecord> {
        let written = self.file.write_all(bytes).and_then(|()| self.file.sync_all());
        written
            .and_then(|()| fs::rename(&self.partial, &self.path))
            .with_context(|| format!("could not write {}", self.path.display()))?;
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        Ok(FileRecord::of_content(&name, "safetensors", bytes))
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // After it got its name there is nothing to remove.
        let _ = fs::remove_file(&self.partial);
    }
}

/// What was made, as it stands in a manifest.
#[derive(Serialize)]
struct Manifest {
    vocabulary: Vec<Entry>,
}

/// One vocabulary.
#[derive(Serialize)]
struct Entry {
    id: String,
    file: String,
    bytes: u64,
    blake3: String,
    method: String,
    seed: u64,
    scenarios: u64,
    /// Digest of the scenarios.
    #[serde(skip_serializing_if = "String::is_empty")]
    data: String,
    /// JSON, as in the file.
    settings: String,
    tokens: Vec<Tokens>,
}

/// The tokens of one class.
#[derive(Serialize)]
struct Tokens {
    class: &'static str,
    tokens: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_mean: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    error_p99: Option<f64>,
}

impl Entry {
    fn new(file: FileRecord, made: &Provenance, tokens: Vec<Tokens>) -> Self {
        let id = Path::new(&file.name).file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let Provenance { method, settings, seed, scenarios, data } = made.clone();
        let settings = settings.to_string();
        let FileRecord { name, bytes, blake3, .. } = file;
        Self { id, file: name, bytes, blake3, method, seed, scenarios, data, settings, tokens }
    }

    fn of_vocabulary(file: FileRecord, vocabulary: &Vocabulary, errors: &MatchingErrors) -> Self {
        let short = |v: f64| (v * 1e5).round() / 1e5;
        let tokens = Class::ALL.map(|class| {
            let error = errors.of(class);
            Tokens {
                class: class.name(),
                tokens: vocabulary.tokens(class),
                error_mean: error.map(|e| short(e.mean)),
                error_p99: error.map(|e| short(e.p99)),
            }
        });
        Self::new(file, vocabulary.provenance(), tokens.into())
    }
}
