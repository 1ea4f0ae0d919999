//! `reactsim curate SCENARIOS`: runs the four steps of curation on files.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Context;
use clap::Args;

use super::source::{OpenSource, SourceChoice, TEMPERATURE, planner_weights};
use crate::cli::inputs::inputs_of;
use crate::cli::output::{ExitStatus, count, nothing, say, say_part, stop_on_interrupt, write_result};
use crate::cli::partition::{self, Partitions};
use crate::cli::progress::Progress;
use crate::curation::driver::{Curated, Curation, Input};
use crate::curation::stats::Statistics;
use crate::curation::store::Writer;
use crate::curation::{
    self, CurationProvenance, CurationSettings, FilterSettings, InputFile, MAX_CANDIDATES, Preselection,
};
use crate::evaluation::{
    FileRecord, ReadingSpec, Registrar, Share, limited, program_commit, program_version, unite,
};
use crate::files::name_of;
use crate::formats::{self, Opener, Partition, count_records};
use crate::report::curation_tables;
use crate::work::available_threads;

/// Arguments of `curate` itself.
#[derive(Debug, Args)]
pub(super) struct MakeArgs {
    /// Files, folders or URLs of scenarios
    #[arg(required_unless_present = "filter", value_name = "SCENARIOS")]
    scenarios: Vec<PathBuf>,
    /// File to write (Parquet), with all candidates; `run --deviations` uses the chosen ones
    #[arg(long, required = true, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Source of the candidates: `rules`; `diffusion`, samples of a network, with the weights that ship, or
    /// diffusion:FILE with others; or file:PATH with trajectories of any planner (Parquet or JSON)
    #[arg(long, default_value = "rules", value_name = "SOURCE")]
    source: SourceChoice,
    /// Standard deviation of the noise from which a network samples candidates [default: 1.5]
    #[arg(long, value_name = "T", value_parser = positive, allow_negative_numbers = true)]
    temperature: Option<f64>,
    /// Maximum number of candidates per scenario [default: 16; of a file, all]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=i64::from(MAX_CANDIDATES)))]
    candidates: Option<u32>,
    /// Seed of all random choices
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Only the first N scenarios, over all files [default: all]
    #[arg(long, value_name = "N")]
    limit: Option<NonZeroUsize>,
    /// Threads; they do not change the result [default: one per core]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=1024))]
    jobs: Option<u16>,
    /// Leave out the scenes that the review page draws: the file is smaller, and the page shows only
    /// the AV
    #[arg(long)]
    without_scenes: bool,
    /// Step 1: keep scenarios with at least N vehicles near the logged AV
    #[arg(long, default_value_t = Preselection::default().min_vehicles, value_name = "N")]
    min_vehicles: u32,
    /// Step 1: largest distance of a vehicle near the AV, m
    #[arg(long, default_value_t = Preselection::default().radius, value_name = "M", value_parser = positive,
          allow_negative_numbers = true)]
    radius: f64,
    /// Step 1: keep scenarios in which one of these has a time to collision below S seconds
    #[arg(long, default_value_t = Preselection::default().max_ttc, value_name = "S", value_parser = positive,
          allow_negative_numbers = true)]
    max_ttc: f64,
    /// Step 3: drop candidates with a mean displacement from the log below M metres
    #[arg(long, default_value_t = FilterSettings::default().min_ade, value_name = "M",
          value_parser = not_negative, allow_negative_numbers = true)]
    min_ade: f64,
    /// Step 3: drop candidates with a corner more than M metres outside the drivable area
    #[arg(long, default_value_t = FilterSettings::default().drivable_tolerance, value_name = "M",
          value_parser = not_negative, allow_negative_numbers = true)]
    drivable_tolerance: f64,
    /// Step 3: also drop candidates that exceed nuPlan's comfort bounds
    #[arg(long)]
    comfort: bool,
}

fn positive(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|v: &f64| *v > 0.0 && v.is_finite()).ok_or("expected a number above 0".into())
}

fn not_negative(text: &str) -> Result<f64, String> {
    text.parse()
        .ok()
        .filter(|v: &f64| *v >= 0.0 && v.is_finite())
        .ok_or("expected 0 or a larger number".into())
}

impl MakeArgs {
    fn settings(&self) -> CurationSettings {
        CurationSettings {
            seed: self.seed,
            candidates: self.candidates.unwrap_or_else(|| self.source.candidates()),
            scenes: !self.without_scenes,
            preselection: Preselection {
                min_vehicles: self.min_vehicles,
                radius: self.radius,
                max_ttc: self.max_ttc,
            },
            filters: FilterSettings {
                min_ade: self.min_ade,
                drivable_tolerance: self.drivable_tolerance,
                comfort: self.comfort,
                ..FilterSettings::default()
            },
        }
    }
}

pub(super) fn make(
    args: &MakeArgs,
    reading: &ReadingSpec,
    partition: Option<Partition>,
) -> anyhow::Result<ExitStatus> {
    // Report every input error before the first scenario.
    let out = args.out()?;
    let source = args.source.open(args.temperature)?;
    let found = inputs_of(reading, &args.scenarios)?;
    if let Some(partition) = partition {
        return find(args, reading, found, partition);
    }
    // From here on there is a file to complete.
    let stop = stop_on_interrupt("writing what is finished")?;
    let mut writer = Writer::create(out)?;
    let found = args.limited(found);
    let total = found.iter().map(|(input, most)| Some(input.count()?.min(*most))).sum();
    let (inputs, _) = args.inputs(found, None)?;
    let settings = args.settings();
    let base = args.provenance(&settings, reading, &inputs)?;
    let jobs = args.jobs();
    let progress = Progress::new();
    progress.set_total(total);
    let curation = Curation { inputs: &inputs, source: source.source(), settings: &settings, jobs };
    let done = curation.run(base, &mut writer, &progress, &stop);
    progress.end();
    finish(args, &source, writer, &done?)
}

/// Finds the candidates of a partition.
fn find(
    args: &MakeArgs,
    reading: &ReadingSpec,
    found: Vec<formats::Input>,
    partition: Partition,
) -> anyhow::Result<ExitStatus> {
    let (out, source, settings) = (args.out()?, args.source.open(args.temperature)?, args.settings());
    let stop = stop_on_interrupt("stopping; an unfinished partition is not kept")?;
    let _lock = partition::folder(out)?;
    let (inputs, ranges) = args.inputs(args.limited(found), Some(partition))?;
    let base = args.provenance(&settings, reading, &inputs)?;
    let progress = Progress::new();
    let curation =
        Curation { inputs: &inputs, source: source.source(), settings: &settings, jobs: args.jobs() };
    let failed = curation.find(&ranges, out, &progress, &stop);
    progress.end();
    match failed? {
        Some(failed) => partition::finish(out, partition, failed, &base),
        None => Ok(ExitStatus::Interrupted),
    }
}

/// Chooses among the candidates of all partitions.
pub(super) fn merge(mut args: MakeArgs, partitions: &Partitions, out: PathBuf) -> anyhow::Result<ExitStatus> {
    let base = partitions.subject(|a: &mut CurationProvenance, b| {
        unite(&mut a.inputs, &mut b.inputs, |file| file.digest.is_empty());
    })?;
    let (mut writer, source) = (Writer::create(&out)?, args.source.open(args.temperature)?);
    args.out = Some(out);
    let progress = Progress::new();
    let curated = curation::merge(base, &partitions.folders, &mut writer, &progress);
    progress.end();
    finish(&args, &source, writer, &curated?)
}

/// Completes the file of a curation and reports about it.
fn finish(
    args: &MakeArgs,
    source: &OpenSource,
    writer: Writer,
    curated: &Curated,
) -> anyhow::Result<ExitStatus> {
    let Curated { provenance, statistics, scenarios } = curated;
    if statistics.funnel.scenarios == 0 && !provenance.interrupted {
        return Err(nothing("no scenario could be read"));
    }
    if args.limit.is_none() && !provenance.interrupted {
        source.compare(scenarios)?;
    }
    let part = match provenance.interrupted {
        true => Some(writer.finish_part(provenance)?),
        false => writer.finish(provenance).map(|()| None)?,
    };
    write_result(None, |out| curation_tables::write_overview(out, statistics))?;
    if let Some(part) = part {
        say_part(&[part], args.out()?, &(count(statistics.scenarios, "scenario") + " with candidates"));
        return Ok(ExitStatus::Interrupted);
    }
    Ok(report(provenance, statistics))
}

impl MakeArgs {
    fn out(&self) -> anyhow::Result<&Path> {
        self.out.as_deref().context("give the file to write with --out")
    }

    /// Returns the number of threads.
    fn jobs(&self) -> usize {
        self.jobs.map_or_else(available_threads, usize::from)
    }

    /// Returns the files as far as they are used.
    fn limited(&self, found: Vec<formats::Input>) -> Vec<Share> {
        limited(found, self.limit.map(NonZeroUsize::get), None)
    }

    /// Returns the inputs with their digests, and which records of each a partition has. Inputs without any
    /// are not read for their digests.
    fn inputs(
        &self,
        found: Vec<Share>,
        partition: Option<Partition>,
    ) -> anyhow::Result<(Vec<Input>, Vec<Range<usize>>)> {
        let openers: Vec<Opener> = found.iter().map(|(input, most)| input.clone().opener(*most)).collect();
        let ranges = match partition {
            None => vec![0..usize::MAX; found.len()],
            Some(partition) => partition.of_inputs(found.len(), 1, |i| count_records(&openers[i])),
        };
        let (mut inputs, mut registrar) = (Vec::new(), Registrar::default());
        for (((input, _), open), range) in found.iter().zip(openers).zip(&ranges) {
            let (name, digest) = match range.is_empty() {
                true => (name_of(&input.path).into_owned(), String::new()),
                false => {
                    let record = registrar.record(input)?;
                    (record.name.clone(), record.digest())
                }
            };
            inputs.push(Input { file: InputFile { name, digest }, open });
        }
        Ok((inputs, ranges))
    }

    /// Returns what is known about the curation before it begins.
    fn provenance(
        &self,
        settings: &CurationSettings,
        reading: &ReadingSpec,
        inputs: &[Input],
    ) -> anyhow::Result<CurationProvenance> {
        Ok(CurationProvenance {
            version: program_version().to_owned(),
            commit: program_commit().to_owned(),
            settings: named(self, settings, reading)?,
            inputs: inputs.iter().map(|i| i.file.clone()).collect(),
            ..CurationProvenance::default()
        })
    }
}

/// Returns all settings by name, those of the command line included.
fn named(
    args: &MakeArgs,
    settings: &CurationSettings,
    reading: &ReadingSpec,
) -> anyhow::Result<BTreeMap<String, String>> {
    let mut named = settings.named();
    match &args.source {
        SourceChoice::Known(id) => named.insert("source".into(), (*id).to_owned()),
        SourceChoice::File(path) => {
            let file = FileRecord::of(path, "deviations")?;
            named.insert("source.blake3".into(), file.blake3);
            named.insert("source".into(), format!("file:{}", file.name))
        }
        SourceChoice::Planner(path) => {
            let file = planner_weights(path.as_deref())?;
            named.insert("source.sha256".into(), file.digest);
            let temperature = args.temperature.unwrap_or(TEMPERATURE);
            named.insert("source.temperature".into(), temperature.to_string());
            named.insert("source".into(), format!("diffusion:{}", file.name))
        }
    };
    named.insert("scenes".into(), settings.scenes.to_string());
    named.extend(reading.named().map(|(key, value)| (key.to_owned(), value)));
    if let Some(limit) = args.limit {
        named.insert("limit".into(), limit.to_string());
    }
    Ok(named)
}

/// Prints warnings about the finished curation and returns its exit status.
fn report(provenance: &CurationProvenance, statistics: &Statistics) -> ExitStatus {
    let failed = provenance.failures.len();
    if failed > 0 {
        say(format_args!("warning: {failed} failed; the others are in the file"));
    }
    if statistics.chosen == 0 {
        say(format_args!("warning: no candidate was chosen: the file is of no use for `run --deviations`"));
    }
    if failed > 0 { ExitStatus::SomeFailed } else { ExitStatus::Done }
}
