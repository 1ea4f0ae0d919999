//! Runs the pipeline over files: scenarios in parallel, choice and writing in the order of the inputs.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use reactsim_formats::{FormatError, Opener, UndecodedScenario, sketch};
use reactsim_generation::{Ending, in_order};

use super::outcomes::RecordOutcome;
use super::stats::{Collector, Statistics};
use super::store::Writer;
use super::{
    CandidateSource, Chooser, CurationOutcome, CurationProvenance, CurationSettings, Funnel, InputFile,
    ScenarioRecord, curate_scenario,
};

/// An input file of scenarios.
pub struct Input {
    /// Its name and digest.
    pub file: InputFile,
    /// Opens the file for reading from the record with this index on.
    pub open: Opener,
}

/// Receives the progress of a curation.
pub trait CurationObserver: Sync {
    /// More records are finished, successful or not; `done` is their total.
    fn scenario_done(&self, _done: usize) {}
    /// A record failed.
    fn failed(&self, _error: &str) {}
}

impl CurationObserver for () {}

/// A curation run: inputs, source and settings.
pub struct Curation<'a> {
    /// Input files, in this order.
    pub inputs: &'a [Input],
    /// Source of the candidates.
    pub source: &'a dyn CandidateSource,
    /// Settings that determine the result.
    pub settings: &'a CurationSettings,
    /// Number of threads; does not affect the result.
    pub jobs: usize,
}

/// Result of a curation.
pub struct Curated {
    /// Provenance of the file.
    pub provenance: CurationProvenance,
    /// Statistics of the set.
    pub statistics: Statistics,
    /// Ids of all scenarios of the inputs, those that failed included as far as they are known.
    pub scenarios: BTreeSet<String>,
}

impl Curation<'_> {
    /// Curates all inputs and writes the scenarios that pass step 1.
    ///
    /// If `stop` is set meanwhile, the file holds the scenarios before the first unfinished one. The
    /// provenance is `base` plus the results; the caller finishes the file with it.
    ///
    /// Unreadable records, scenarios that the source refuses and scenarios with a duplicate id are failures:
    /// they are reported to the observer and listed in the provenance, and do not end the run.
    ///
    /// # Errors
    /// [`FormatError`] when the file cannot be written.
    pub fn run(
        &self,
        base: CurationProvenance,
        writer: &mut Writer,
        observer: &dyn CurationObserver,
        stop: &AtomicBool,
    ) -> Result<Curated, FormatError> {
        let mut collector = ResultCollector::new(base, observer);
        let records = (0..self.inputs.len()).flat_map(|input| self.pending(input, 0));
        let finished = self.each(records, stop, |CuratedRecord { input, number, outcome }| {
            collector.take(&self.inputs[input].file, number, outcome, writer)?;
            observer.scenario_done(collector.done);
            Ok(())
        })?;
        collector.provenance.interrupted = !finished;
        Ok(collector.finish())
    }

    /// Curates records on several threads and passes the outcomes to `take` in the order of the records.
    /// Returns whether all are finished: `stop` ends the work before the first unfinished one.
    pub(super) fn each(
        &self,
        records: impl Iterator<Item = PendingRecord>,
        stop: &AtomicBool,
        mut take: impl FnMut(CuratedRecord) -> Result<(), FormatError>,
    ) -> Result<bool, FormatError> {
        let curate = |(): &(), record| self.curate(record);
        let take = |(): &mut (), curated| take(curated).map(ControlFlow::Continue);
        Ok(in_order(records, self.jobs, stop, &mut (), curate, take)? == Ending::Done)
    }

    /// Returns the records of a file from the one with this index on, or the error if the file cannot be
    /// opened.
    pub(super) fn pending(&self, input: usize, first: usize) -> Box<dyn Iterator<Item = PendingRecord>> {
        let place = move |(number, content)| PendingRecord { input, number: first + number, content };
        match self.inputs.get(input).map(|input| (input.open)(first)) {
            Some(Ok(records)) => Box::new(records.enumerate().map(place)),
            Some(Err(error)) => Box::new(std::iter::once(place((0, Err(error))))),
            None => Box::new(std::iter::empty()),
        }
    }

    /// Decodes and curates one record, on any thread.
    fn curate(&self, record: PendingRecord) -> CuratedRecord {
        let PendingRecord { input, number, content } = record;
        let scenario = content.and_then(UndecodedScenario::decode);
        let curated = scenario.and_then(|scenario| {
            self.source.check(&scenario).map_err(|cause| {
                FormatError::record(Path::new(""), number as u64, Some(scenario.id.clone()), cause)
            })?;
            let mut curated = curate_scenario(&scenario, self.source, self.settings);
            if let CurationOutcome::Retained(record, _) = &mut curated {
                record.scene = self.settings.scenes.then(|| sketch(&scenario));
            }
            let (scenario, source) = (scenario.id, scenario.source);
            Ok(RecordOutcome::Curated { scenario, source, outcome: curated })
        });
        let outcome = curated.unwrap_or_else(|mut error| {
            // The provenance must not reveal the folder of the file.
            error.path = PathBuf::from(&self.inputs[input].file.name);
            RecordOutcome::Failed { error: error.to_string(), scenario: error.scenario }
        });
        CuratedRecord { input, number, outcome }
    }
}

/// A record that has not been decoded yet.
pub(super) struct PendingRecord {
    input: usize,
    number: usize,
    content: Result<UndecodedScenario, FormatError>,
}

pub(super) struct CuratedRecord {
    pub(super) input: usize,
    pub(super) number: usize,
    pub(super) outcome: RecordOutcome,
}

/// Collects results in the order of the inputs.
pub(super) struct ResultCollector<'a> {
    provenance: CurationProvenance,
    observer: &'a dyn CurationObserver,
    /// Number of records so far.
    pub(super) done: usize,
    ids: BTreeSet<String>,
    /// Ids of scenarios that failed, as far as known.
    failed: BTreeSet<String>,
    chooser: Chooser,
    collector: Collector,
}

impl<'a> ResultCollector<'a> {
    pub(super) fn new(provenance: CurationProvenance, observer: &'a dyn CurationObserver) -> Self {
        Self {
            provenance,
            observer,
            done: 0,
            ids: BTreeSet::new(),
            failed: BTreeSet::new(),
            chooser: Chooser::default(),
            collector: Collector::default(),
        }
    }

    pub(super) fn finish(mut self) -> Curated {
        let statistics = self.collector.finish(&self.provenance);
        self.ids.append(&mut self.failed);
        Curated { provenance: self.provenance, statistics, scenarios: self.ids }
    }

    /// Adds the outcome of the next record.
    pub(super) fn take(
        &mut self,
        file: &InputFile,
        number: usize,
        outcome: RecordOutcome,
        writer: &mut Writer,
    ) -> Result<(), FormatError> {
        self.done += 1;
        let (id, curated) = match outcome {
            RecordOutcome::Curated { scenario, outcome, .. } => (scenario, Some(outcome)),
            RecordOutcome::Repeated { scenario } => (scenario, None),
            RecordOutcome::Failed { error, scenario } => {
                self.failed.extend(scenario);
                self.fail(error);
                return Ok(());
            }
        };
        let is_new = self.ids.insert(id.clone());
        let Some(curated) = curated.filter(|_| is_new) else {
            let name = &file.name;
            self.fail(format!(
                "{name}: record {number}: scenario `{id}`: an earlier one has this id; \
                 give each scenario once"
            ));
            return Ok(());
        };
        let funnel = &mut self.provenance.funnel;
        funnel.scenarios += 1;
        match curated {
            CurationOutcome::Rejected { rule } => *funnel.preselection.entry(rule).or_default() += 1,
            CurationOutcome::Retained(mut record, unproposed) => {
                self.chooser.choose(&mut record);
                count(funnel, &record, unproposed);
                // The writer decides whether the file holds the record, so that statistics and file
                // agree.
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

/// Adds a scenario that passed step 1 to the funnel, and its numbers of streams without a proposal.
pub(super) fn count(funnel: &mut Funnel, record: &ScenarioRecord, unproposed: BTreeMap<String, u64>) {
    for (reason, n) in unproposed {
        *funnel.unproposed.entry(reason).or_default() += n;
    }
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
