//! Generation in partitions: ranges of the numbers of scenarios.

use std::ops::{ControlFlow, Range};
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::bench::{bench, curation_settings, provenance};
use super::job::{GenerateArgs, GeneratedFiles, Job, finish, write_all};
use super::scenario_file::{ScenarioFile, read_scenarios};
use super::tried::{curated, read_tried};
use crate::cli::output::{ExitStatus, stop_on_interrupt};
use crate::cli::partition::{self, Partitions};
use crate::cli::progress::Progress;
use crate::curation::CurationProvenance;
use crate::curation::outcomes::OutcomeWriter;
use crate::evaluation::program_version;
use crate::formats::native::Writer;
use crate::formats::{FormatError, Partition};
use crate::generation::{Ending, GenerationSettings, Generator, Preset, VERSION, in_order};
use crate::scene::Length;

/// Number of scenarios of a benchmark that partitions try, per requested scenario; the merge tries more if
/// they are not enough.
const TRIED_PER_SCENARIO: usize = 4;

/// Settings that determine generated scenarios.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct GenerationSubject {
    program: String,
    generator: u32,
    preset: String,
    count: u32,
    seed: u64,
    maps: Vec<String>,
    density: Option<f64>,
    /// Frames up to and including the current one, and after it, of other lengths than that of the benchmark.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    length: Option<[usize; 2]>,
    /// How a benchmark is curated.
    curation: Option<CurationProvenance>,
}

impl GenerationSubject {
    fn of(settings: &GenerationSettings, count: u32) -> Self {
        let GenerationSettings { preset, seed, maps, density, length } = settings;
        Self {
            program: program_version().to_owned(),
            generator: VERSION,
            preset: preset.name().to_owned(),
            count,
            seed: *seed,
            maps: maps.clone(),
            density: *density,
            length: (*length != Length::BENCHMARK).then_some([length.history, length.future]),
            curation: (*preset == Preset::Bench).then(|| provenance(settings, count)),
        }
    }
}

/// Returns the number of scenarios of all partitions.
fn numbers(settings: &GenerationSettings, wanted: u32) -> usize {
    match settings.preset {
        Preset::Train | Preset::Sensed => wanted as usize,
        Preset::Bench => TRIED_PER_SCENARIO * wanted as usize,
    }
}

/// Generates the scenarios of a partition.
pub(super) fn generate(args: &GenerateArgs, partition: Partition) -> anyhow::Result<ExitStatus> {
    let (out, wanted, settings) = (args.out.as_path(), args.count, &args.settings()?);
    let generator = Generator::new(settings.clone())?;
    let stop = stop_on_interrupt("stopping; an unfinished partition is not kept")?;
    let _lock = partition::folder(out)?;
    let progress = Progress::new();
    let range = partition.of(numbers(settings, wanted));
    progress.set_total(Some(range.len()));
    let job = Job { settings, wanted, jobs: args.jobs.count(), out, progress: &progress, stop: &stop };
    let failed = match settings.preset {
        Preset::Train | Preset::Sensed => plain(job, &generator, &range),
        Preset::Bench => tried(job, &generator, &range),
    };
    progress.end();
    match failed? {
        Some(failed) => partition::finish(out, partition, failed, &GenerationSubject::of(settings, wanted)),
        None => Ok(ExitStatus::Interrupted),
    }
}

/// Writes scenarios as they are; returns the number of failures, or `None` if the work was interrupted.
fn plain(job: Job<'_>, generator: &Generator, range: &Range<usize>) -> Result<Option<usize>, FormatError> {
    let mut scenarios = ScenarioFile::new(job.out);
    let numbers = range.start as u64..range.end as u64;
    let (ending, _, failed) = write_all(job, generator, numbers, |scenario| scenarios.write(scenario))?;
    if ending == Ending::Stopped {
        return Ok(None);
    }
    scenarios.finish()?;
    Ok(Some(failed))
}

/// Writes scenarios that are curated up to the choice; returns as [`plain`].
fn tried(job: Job<'_>, generator: &Generator, range: &Range<usize>) -> Result<Option<usize>, FormatError> {
    let (mut scenarios, mut outcomes) = (ScenarioFile::new(job.out), OutcomeWriter::create(job.out)?);
    let settings = curation_settings(job.settings);
    let (mut done, mut failed) = (0, 0);
    let make = |_: &(), number| curated(generator.scenario(number as u64), &settings);
    let ending = in_order(range.clone(), job.jobs, job.stop, &mut (), make, |(), (kept, outcome)| {
        kept.iter().try_for_each(|scenario| scenarios.write(scenario))?;
        failed += usize::from(outcomes.write((0, done), outcome)?);
        done += 1;
        job.progress.set_done(done);
        Ok::<_, FormatError>(ControlFlow::Continue(()))
    })?;
    if ending == Ending::Stopped {
        return Ok(None);
    }
    outcomes.finish()?;
    scenarios.finish()?;
    Ok(Some(failed))
}

/// Joins all partitions.
pub(in crate::cli) fn merge(
    mut args: GenerateArgs,
    partitions: &Partitions,
    out: PathBuf,
) -> anyhow::Result<ExitStatus> {
    partitions.subject(|_: &mut GenerationSubject, _| ())?;
    args.out = out;
    let (out, wanted, settings) = (args.out.as_path(), args.count, &args.settings()?);
    let progress = Progress::new();
    let generated = match settings.preset {
        Preset::Train | Preset::Sensed => merge_plain(partitions, out),
        Preset::Bench => {
            let tried = (numbers(settings, wanted) as u64, read_tried(&partitions.folders));
            let (jobs, stop) = (args.jobs.count(), &AtomicBool::new(false));
            bench(Job { settings, wanted, jobs, out, progress: &progress, stop }, tried)
        }
    };
    progress.end();
    finish(&args, &generated?)
}

/// Joins scenarios as they are.
fn merge_plain(partitions: &Partitions, out: &Path) -> anyhow::Result<GeneratedFiles> {
    let mut writer = Writer::create(out)?;
    let mut written = 0;
    for folder in &partitions.folders {
        for scenario in read_scenarios(folder)? {
            writer.write(&scenario?)?;
            written += 1;
        }
    }
    if written > 0 {
        writer.finish()?;
    }
    let (files, failed) = (vec![out.to_owned()], partitions.failed());
    Ok(GeneratedFiles { files, written, failed, unfilled: false, interrupted: false })
}
