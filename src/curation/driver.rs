//! Carries the pipeline out over files: scenarios side by side, choice and writing in the order of the inputs.

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use rayon::prelude::*;

use super::stats::{Collector, Statistics};
use super::store::Writer;
use super::{
    CandidateSource, Chooser, Curated, CurationProvenance, CurationSettings, Funnel, InputFile,
    ScenarioRecord, curate_scenario,
};
use crate::formats::{FormatError, PendingScenarios, Undecoded};

/// Scenarios per thread that are in memory at a time: enough that threads seldom wait for the slowest.
const CHUNK: usize = 8;
/// More threads than this are never started.
const MOST_JOBS: usize = 512;

/// A file of scenarios.
pub struct Input {
    /// Its name and digest.
    pub file: InputFile,
    /// Opens it for reading from its beginning.
    pub open: Box<dyn Fn() -> Result<PendingScenarios, FormatError> + Send + Sync>,
}

/// Is told how a curation goes on.
pub trait CurationObserver: Sync {
    /// Records are done, well or not; `done` counts them.
    fn scenario_done(&self, _done: usize) {}
    /// A record failed.
    fn failed(&self, _error: &str) {}
}

/// What is asked of a curation.
pub struct Curation<'a> {
    /// Where scenarios come from, in this order.
    pub inputs: &'a [Input],
    /// Who proposes candidates.
    pub source: &'a dyn CandidateSource,
    /// What decides the result.
    pub settings: &'a CurationSettings,
    /// Threads; decide no byte of the result.
    pub jobs: usize,
}

impl Curation<'_> {
    /// Curates all inputs and writes what passes step 1. Where `stop` is set meanwhile, the file holds what comes before the first
    /// scenario that was not finished. The provenance is `base` with what was found; it is for the caller to finish the file with it.
    /// Beside it, the figures of the set.
    ///
    /// Records that can not be read, and scenarios whose id an earlier one has, are failures: told to the observer, listed in the
    /// provenance. They end nothing.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be written.
    pub fn run(
        &self,
        base: CurationProvenance,
        writer: &mut Writer,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<(CurationProvenance, Statistics), FormatError> {
        let jobs = self.jobs.clamp(1, MOST_JOBS);
        // Where the system grants no threads of our own, those that there are do the work.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build().ok();
        let mut desk = Desk::new(base, observer);
        let mut records = self.inputs.iter().enumerate().flat_map(|(i, input)| pending(i, input));
        loop {
            let chunk: Vec<Pending> = records.by_ref().take(jobs * CHUNK).collect();
            if chunk.is_empty() {
                return Ok(desk.finish());
            }
            let curate = || chunk.into_par_iter().map(|record| self.curate(record, stop)).collect::<Vec<_>>();
            let results = match &pool {
                Some(pool) => pool.install(curate),
                None => curate(),
            };
            for result in results {
                let Some(result) = result else {
                    desk.provenance.interrupted = true;
                    return Ok(desk.finish());
                };
                desk.take(&self.inputs[result.input].file, result, writer)?;
            }
            observer.scenario_done(desk.done);
        }
    }

    /// Decodes and curates one record, on any thread. `None` where it was not begun because of `stop`.
    fn curate(&self, record: Pending, stop: &AtomicBool) -> Option<Done> {
        if stop.load(Ordering::Relaxed) {
            return None;
        }
        let Pending { input, number, content } = record;
        let scenario = content.and_then(|decode| decode());
        let curated = scenario.map(|scenario| {
            let curated = curate_scenario(&scenario, self.source, self.settings);
            (scenario.id, curated)
        });
        Some(Done { input, number, curated })
    }
}

/// A record that is still to be decoded.
struct Pending {
    input: usize,
    number: usize,
    content: Result<Undecoded, FormatError>,
}

/// The records of a file; of one that can not be opened, the error.
fn pending(index: usize, input: &Input) -> Box<dyn Iterator<Item = Pending>> {
    let place = move |(number, content)| Pending { input: index, number, content };
    match (input.open)() {
        Ok(records) => Box::new(records.enumerate().map(place)),
        Err(error) => Box::new(std::iter::once(place((0, Err(error))))),
    }
}

/// A record that is done.
struct Done {
    input: usize,
    number: usize,
    curated: Result<(String, Curated), FormatError>,
}

/// Takes results in the order of the inputs.
struct Desk<'a> {
    provenance: CurationProvenance,
    observer: &'a dyn CurationObserver,
    done: usize,
    ids: BTreeSet<String>,
    chooser: Chooser,
    collector: Collector,
}

impl<'a> Desk<'a> {
    fn new(provenance: CurationProvenance, observer: &'a dyn CurationObserver) -> Self {
        let (chooser, collector) = (Chooser::new(), Collector::default());
        Self { provenance, observer, done: 0, ids: BTreeSet::new(), chooser, collector }
    }

    fn finish(self) -> (CurationProvenance, Statistics) {
        let statistics = self.collector.finish(&self.provenance);
        (self.provenance, statistics)
    }

    fn take(&mut self, file: &InputFile, done: Done, writer: &mut Writer) -> Result<(), FormatError> {
        self.done += 1;
        let (id, curated) = match done.curated {
            Ok(curated) => curated,
            Err(mut error) => {
                // Where the file lies is nobody else's concern.
                error.path = PathBuf::from(&file.name);
                self.fail(error.to_string());
                return Ok(());
            }
        };
        if !self.ids.insert(id.clone()) {
            let (name, number) = (&file.name, done.number);
            self.fail(format!(
                "{name}: record {number}: scenario `{id}`: an earlier one has this id; give each scenario once"
            ));
            return Ok(());
        }
        let funnel = &mut self.provenance.funnel;
        funnel.scenarios += 1;
        match curated {
            Curated::Dropped { rule } => *funnel.preselection.entry(rule).or_default() += 1,
            Curated::Kept(mut record, unproposed) => {
                self.chooser.choose(&mut record);
                count(funnel, &record);
                for (reason, n) in unproposed {
                    *funnel.unproposed.entry(reason).or_default() += n;
                }
                // What the file holds is for the writer to say, so that figures of the file are the same.
                if writer.write(&record)? {
                    self.collector.add(&record);
                }
            }
        }
        Ok(())
    }

    fn fail(&mut self, error: String) {
        self.observer.failed(&error);
        self.provenance.failures.push(error);
    }
}

/// Counts a scenario that passed step 1.
pub(super) fn count(funnel: &mut Funnel, record: &ScenarioRecord) {
    funnel.preselected += 1;
    funnel.candidates += record.candidates.len() as u64;
    for candidate in &record.candidates {
        match &candidate.rejected_by {
            Some(filter) => *funnel.rejected.entry(filter.clone()).or_default() += 1,
            None => funnel.survivors += 1,
        }
    }
    funnel.chosen += u64::from(record.chosen().is_some());
}
