//! Generation in units: ranges of the numbers of scenarios.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use serde::{Deserialize, Serialize};

use super::bench::{bench, provenance};
use super::files::GeneratedFiles;
use super::make::{GenerateArgs, Job, finish};
use super::scenario_file::{ScenarioFile, read_scenarios};
use super::tried::{Trial, TriedWriter, read_tried};
use crate::cli::ExitStatus;
use crate::cli::progress::Progress;
use crate::cli::sharded::{Sharded, WorkSettings};
use crate::curation::CurationProvenance;
use crate::curation::driver::CurationObserver;
use crate::evaluation::program_version;
use crate::files::{read_regular, replace};
use crate::formats::FormatError;
use crate::formats::native::Writer;
use crate::generation::{Ending, GenerationSettings, Generator, Preset, VERSION, in_order};
use crate::shards::{FinishedUnits, RecordRange, ShardError, ShardPlan, Unit, UnitResults, Work};

/// Name of the file with the reasons why scenarios could not be generated, one per line.
const FAILURES: &str = "failures.jsonl";

/// Number of scenarios of a benchmark that units try, per requested scenario; the merge tries more if they
/// are not enough.
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
    /// How a benchmark is curated.
    curation: Option<CurationProvenance>,
}

impl GenerationSubject {
    fn of(settings: &GenerationSettings, count: u32) -> Self {
        let GenerationSettings { preset, seed, maps, density } = settings;
        Self {
            program: program_version().to_owned(),
            generator: VERSION,
            preset: preset.name().to_owned(),
            count,
            seed: *seed,
            maps: maps.clone(),
            density: *density,
            curation: (*preset == Preset::Bench).then(|| provenance(settings, count)),
        }
    }
}

impl Sharded for GenerateArgs {
    fn check(&self) -> anyhow::Result<()> {
        Generator::new(self.settings()?)?;
        Ok(())
    }

    fn divide(&self, arguments: Vec<String>, records: usize) -> anyhow::Result<ShardPlan> {
        let (settings, wanted) = (self.settings()?, self.count);
        let numbers = match settings.preset {
            Preset::Train | Preset::Sensed => wanted as usize,
            Preset::Bench => TRIED_PER_SCENARIO * wanted as usize,
        };
        Ok(ShardPlan::divide(arguments, &GenerationSubject::of(&settings, wanted), &[numbers], records)?)
    }

    fn jobs(&self) -> usize {
        self.jobs()
    }

    fn prepare<'a>(
        &'a self,
        _: &ShardPlan,
        _: &[usize],
        settings: WorkSettings<'a>,
    ) -> anyhow::Result<Box<dyn Work + 'a>> {
        let generation = self.settings()?;
        let subject = GenerationSubject::of(&generation, self.count);
        let generator = Generator::new(generation.clone())?;
        Ok(Box::new(GenerationWork { generation, generator, subject, how: settings }))
    }

    fn merge(
        &self,
        plan: &ShardPlan,
        units: &FinishedUnits,
        progress: &Progress,
    ) -> anyhow::Result<ExitStatus> {
        let (out, wanted, settings) = (self.out.as_path(), self.count, self.settings()?);
        let generated = match settings.preset {
            Preset::Train | Preset::Sensed => merge_train(units, out, progress),
            Preset::Bench => {
                plan.check(&GenerationSubject::of(&settings, wanted))?;
                let tried = (plan.records() as u64, read_tried(&units.units));
                let (settings, jobs, stop) = (&settings, self.jobs(), &AtomicBool::new(false));
                bench(Job { settings, wanted, jobs, out, progress, stop }, tried)
            }
        };
        progress.end();
        finish(self, &generated?)
    }
}

/// Joins the scenarios of all units.
fn merge_train(units: &FinishedUnits, out: &Path, progress: &Progress) -> anyhow::Result<GeneratedFiles> {
    let mut writer = Writer::create(out)?;
    let (mut written, mut failed) = (0, 0);
    for unit in &units.units {
        let damaged = |name: &str, reason: String| unit.damaged(format!("{name}: {reason}"));
        let text = read_regular(&unit.results().join(FAILURES));
        let text = text.map_err(|error| damaged(FAILURES, error.to_string()))?;
        for line in text.split(|byte| *byte == b'\n').filter(|line| !line.is_empty()) {
            let error: String = serde_json::from_slice(line).map_err(|e| damaged(FAILURES, e.to_string()))?;
            progress.failed(&error);
            failed += 1;
        }
        let scenarios = read_scenarios(&unit.results()).map_err(|e| unit.damaged(e.to_string()))?;
        for scenario in scenarios {
            writer.write(&scenario.map_err(|error| unit.damaged(error.to_string()))?)?;
            written += 1;
        }
        progress.scenario_done(written + failed);
    }
    if written > 0 {
        writer.finish()?;
    }
    let files = vec![out.to_owned()];
    Ok(GeneratedFiles { files, written, failed, unfilled: false, interrupted: false })
}

/// A generation, prepared in this process.
struct GenerationWork<'a> {
    generation: GenerationSettings,
    generator: Generator,
    subject: GenerationSubject,
    how: WorkSettings<'a>,
}

impl GenerationWork<'_> {
    /// Generates scenarios as they are.
    fn train(&self, range: RecordRange, folder: &Path) -> Result<Option<UnitResults>, ShardError> {
        let mut scenarios = ScenarioFile::new(folder);
        let mut failures: Vec<String> = Vec::new();
        let mut records = 0;
        let generate = |_: &(), number| self.generator.scenario(range.first as u64 + number);
        let (jobs, stop) = (self.how.jobs, self.how.stop);
        let ending = in_order(range.count as u64, jobs, stop, &mut (), generate, |(), _, scenario| {
            records += 1;
            match scenario {
                Ok(scenario) => scenarios.write(&scenario)?,
                Err(error) => {
                    self.how.progress.failed(&error.to_string());
                    failures.push(error.to_string());
                }
            }
            self.how.progress.set_done(records);
            Ok::<_, FormatError>(ControlFlow::Continue(()))
        })
        .map_err(ShardError::work)?;
        if ending == Ending::Stopped {
            return Ok(None);
        }
        let mut files = vec![FAILURES];
        files.extend(scenarios.finish().map_err(ShardError::work)?);
        let path = folder.join(FAILURES);
        let lines: Vec<String> =
            failures.iter().map(|f| serde_json::Value::from(f.as_str()).to_string()).collect();
        replace(&path, |out| lines.iter().try_for_each(|line| writeln!(out, "{line}")))
            .map_err(|source| ShardError::Write { path, source })?;
        Ok(Some(UnitResults { records, failed: failures.len(), files }))
    }

    /// Generates scenarios and curates them up to the choice.
    fn bench(&self, range: RecordRange, folder: &Path) -> Result<Option<UnitResults>, FormatError> {
        let mut writer = TriedWriter::create(folder)?;
        let trial = Trial::new(&self.generation);
        let (mut records, mut failed) = (0, 0);
        let make = |_: &(), number| trial.of(self.generator.scenario(range.first as u64 + number));
        let (jobs, stop) = (self.how.jobs, self.how.stop);
        let ending = in_order(range.count as u64, jobs, stop, &mut (), make, |(), _, tried| {
            records += 1;
            failed += usize::from(writer.write(tried)?);
            self.how.progress.set_done(records);
            Ok::<_, FormatError>(ControlFlow::Continue(()))
        })?;
        if ending == Ending::Stopped {
            return Ok(None);
        }
        Ok(Some(UnitResults { records, failed, files: writer.finish()? }))
    }
}

impl Work for GenerationWork<'_> {
    fn check(&self, plan: &ShardPlan, _: &Unit) -> Result<(), ShardError> {
        plan.check(&self.subject)
    }

    fn carry_out(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, ShardError> {
        match self.generation.preset {
            Preset::Train | Preset::Sensed => self.train(unit.range, folder),
            Preset::Bench => self.bench(unit.range, folder).map_err(ShardError::work),
        }
    }
}
