//! Execution of a plan on several threads. Results do not depend on the number of threads, the batch size or
//! interruptions.

pub(crate) mod merge;
pub(crate) mod omissions;

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};
use std::thread;

use parking_lot::Mutex;
use reactsim_files::work::{MAX_THREADS, Pool};
use reactsim_formats::UndecodedScenario;
use reactsim_planning::PlanningMap;
use reactsim_rollout::{Av, Request, Rollout, roll_out_while};
use reactsim_scene::Scenario;

use crate::av::AvChoice;
use crate::deviation::labels::DeviationLabels;
use crate::driver::GivenPlans;
use crate::error::EvaluationError;
use crate::folder::rollouts;
use crate::folder::{RunFolder, line};
use crate::judge::judge;
use crate::layout::LEFT_OUT;
use crate::motion::kind::RolloutCheck;
use crate::motion::{CheckedScene, Finding};
use crate::plan::{NoAv, Plan};
use crate::provenance::Provenance;
use crate::row::{Failure, RecordPosition, Row};
use crate::runner::omissions::Omissions;
use crate::source::{Source, Supply, UndecodedRecord};
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// Execution settings of a run, which do not affect its numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Execution {
    /// Number of threads, at most 512.
    pub jobs: usize,
    /// Number of scenarios that a thread steps in lockstep and keeps in memory.
    pub batch: usize,
}

/// Callbacks for the progress of a run.
pub trait RunObserver: Sync {
    /// Called at the start with the number of records of all sources, if it is known.
    fn started(&self, _total: Option<usize>) {}
    /// Called before each step of a batch of rollouts, with the number of its realised steps and of all its
    /// steps.
    fn stepped(&self, _step: usize, _steps: usize) {}
    /// Called after scenarios succeeded or failed. `done` is the number of finished scenarios, including
    /// those of an earlier interrupted run.
    fn scenario_done(&self, _done: usize) {}
    /// Called with the rows of one scenario and one simulator.
    fn rows(&self, _rows: &[Row]) {}
    /// Called when a scenario, a file or a pair of scenario and simulator failed.
    fn failed(&self, _failure: &Failure) {}
}

/// Ignores all progress.
impl RunObserver for () {}

/// The end of a run.
#[derive(Debug)]
pub enum Outcome {
    /// Every scenario was tried.
    Finished(Box<Summary>),
    /// `stop` was set; the folder can be resumed.
    Interrupted,
}

/// Runs a plan. With a folder, rows are appended as they finish; `tally` contains the results of an earlier
/// run.
///
/// # Errors
/// [`EvaluationError`] if the folder cannot be written; finished rows stay in it.
pub fn run(
    plan: &Plan,
    execution: Execution,
    folder: Option<&RunFolder>,
    tally: Tally,
    observer: &dyn RunObserver,
    stop: &AtomicBool,
) -> Result<Outcome, EvaluationError> {
    let block = records_per_block(plan)?;
    let ranges = Source::ranges(&plan.sources, plan.partition, block.unwrap_or(1));
    let known = |(source, range): (&Source, &Range<usize>)| match range.end {
        usize::MAX => source.count,
        _ => Some(range.len()),
    };
    observer.started(plan.sources.iter().zip(&ranges).map(known).sum());
    let runner = Runner {
        plan,
        execution,
        records: block.unwrap_or(execution.batch),
        folder,
        observer,
        stop,
        supply: Supply::new(&plan.sources, ranges),
        done: AtomicUsize::new(0),
        // All threads read the results of an earlier run; those of this run are collected separately.
        before: tally.clone(),
        tally: Mutex::new(tally),
        failures: Mutex::default(),
        omissions: Mutex::default(),
        broken: Mutex::default(),
    };
    thread::scope(|scope| {
        for _ in 1..execution.jobs.min(MAX_THREADS) {
            // If the system refuses more threads, the existing ones do the work.
            if thread::Builder::new().spawn_scoped(scope, || runner.work()).is_err() {
                break;
            }
        }
        runner.work();
    });
    if let Some(error) = runner.broken.into_inner() {
        return Err(error);
    }
    if stop.load(Ordering::Relaxed) {
        return Ok(Outcome::Interrupted);
    }
    let (mut tally, mut failures) = (runner.tally.into_inner(), runner.failures.into_inner());
    let provenance = plan.provenance();
    // Only when all partitions are there, it is known which scenario is the first one with an id.
    if plan.partition.is_none() {
        for failure in refuse_repeated(&provenance, &mut tally) {
            observer.failed(&failure);
            failures.push(failure);
        }
    }
    failures.sort();
    let mut summary = Pool::new(execution.jobs).install(|| Summary::new(&tally, &failures, &provenance));
    let mut omissions = runner.omissions.into_inner();
    omissions.deviations = plan.selected_deviations();
    // Scenarios with rows of an earlier run were not read again.
    omissions.read(plan, tally.entries.values().map(|e| &e.scenario));
    omissions.describe(&mut summary.provenance);
    if let Some(folder) = folder {
        if plan.partition.is_some() {
            folder.put(LEFT_OUT, &line(&omissions))?;
        }
        folder.complete(&tally, &failures, &summary, plan.spec.keeps_rollouts())?;
    }
    Ok(Outcome::Finished(Box::new(summary)))
}

/// Largest number of records that a thread takes at once.
const MOST_RECORDS: usize = 4096;

/// Returns the number of records that must not be divided: whole batches of every external simulator, whose
/// composition must not depend on threads, partitions or interruptions. `None` without external simulators.
fn records_per_block(plan: &Plan) -> Result<Option<usize>, EvaluationError> {
    let entering = plan.spec.settings().entering;
    let batches = || plan.simulators.iter().filter_map(|simulator| simulator.batch(entering));
    let block = batches().reduce(least_common_multiple);
    if block.is_some_and(|records| records > MOST_RECORDS) {
        let batches: Vec<usize> = batches().collect();
        return Err(EvaluationError::Refused(format!(
            "external simulators with batches of {batches:?} episodes: their least common multiple exceeds \
             {MOST_RECORDS}; give `external-batch`"
        )));
    }
    Ok(block)
}

fn least_common_multiple(a: usize, b: usize) -> usize {
    let (mut x, mut y) = (a, b);
    while y != 0 {
        (x, y) = (y, x % y);
    }
    (a / x.max(1)).saturating_mul(b)
}

/// Removes scenarios with the id of an earlier one and returns their failures. Only the order of the inputs
/// decides which one is earlier.
pub(super) fn refuse_repeated(run: &Provenance, tally: &mut Tally) -> Vec<Failure> {
    let repeated = tally.repeated();
    let refuse = |(place, earlier): (RecordPosition, RecordPosition)| {
        let entry = tally.entries.remove(&place)?;
        let (file, first) = (&run.inputs[place.input], &run.inputs[earlier.input]);
        let error = format!(
            "{}: record {}: scenario `{}`: the id is taken by record {} of {}; give each scenario once",
            file.name, place.record, entry.scenario, earlier.record, first.name
        );
        Some(Failure::new(place, file, Some(entry.scenario), error))
    };
    repeated.into_iter().filter_map(refuse).collect()
}

struct Runner<'a> {
    plan: &'a Plan,
    execution: Execution,
    /// Number of records that a thread takes at once.
    records: usize,
    folder: Option<&'a RunFolder>,
    observer: &'a dyn RunObserver,
    stop: &'a AtomicBool,
    supply: Supply<'a>,
    done: AtomicUsize,
    before: Tally,
    tally: Mutex<Tally>,
    failures: Mutex<Vec<Failure>>,
    omissions: Mutex<Omissions>,
    /// The first error that stops the run.
    broken: Mutex<Option<EvaluationError>>,
}

/// A scenario of a batch that is ready to run.
struct PreparedScenario {
    place: RecordPosition,
    scenario: Scenario,
    digest: String,
    /// AV of all rollouts; `None` if the simulator moves it.
    av: Option<Arc<dyn Av>>,
    deviation: DeviationLabels,
    /// Checks that the given trajectory of the AV fails, all of them allowed.
    allowed: Vec<RolloutCheck>,
    /// Plans of the AV that have to be checked.
    given: Arc<GivenPlans>,
    /// Planning map on which the AV is judged, too, made at first use; `None` if the AV is not judged.
    av_map: Option<OnceLock<Arc<PlanningMap>>>,
}

/// Reason why a record is not run.
enum Refused {
    /// The record has no result.
    Record(Box<Failure>),
    /// The whole run stops.
    Run(EvaluationError),
}

impl Runner<'_> {
    fn is_interrupted(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }

    fn stopped(&self) -> bool {
        self.is_interrupted() || self.broken.lock().is_some()
    }

    /// Processes batches until the sources are exhausted or the run stops; the main function of each thread.
    fn work(&self) {
        while !self.stopped() {
            let Some(items) = self.supply.take(self.records) else { return };
            let result = self.batch(items);
            if let Err(error) = result {
                self.broken.lock().get_or_insert(error);
            }
        }
    }

    fn batch(&self, items: Vec<UndecodedRecord>) -> Result<(), EvaluationError> {
        let records = items.len();
        let mut ready = Vec::with_capacity(records);
        let places: Vec<RecordPosition> = items.iter().map(|item| item.place).collect();
        for item in items {
            if !(0..self.plan.simulators.len()).any(|s| self.is_needed(item.place, s, &places)) {
                continue;
            }
            match self.prepare(item) {
                Ok(Some(scenario)) => ready.push(scenario),
                Ok(None) => {}
                // The end of the program may be the reason; the record is read again when the run goes on.
                Err(_) if self.is_interrupted() => {}
                Err(Refused::Record(failure)) => self.fail(*failure)?,
                Err(Refused::Run(error)) => return Err(error),
            }
        }
        for simulator in 0..self.plan.simulators.len() {
            if self.stopped() {
                return Ok(());
            }
            let todo: Vec<&PreparedScenario> =
                ready.iter().filter(|r| self.is_needed(r.place, simulator, &places)).collect();
            // Scenarios of a batch have one length.
            let is_alike =
                |a: &PreparedScenario, b: &PreparedScenario| a.scenario.length() == b.scenario.length();
            match self.plan.simulators[simulator].batch(self.plan.spec.settings().entering) {
                None => {
                    let parts = todo.chunk_by(|a, b| is_alike(a, b));
                    for part in parts.flat_map(|part| part.chunks(self.execution.batch.max(1))) {
                        self.simulate(part, simulator)?;
                    }
                }
                Some(size) => {
                    let batches = todo
                        .chunk_by(|a, b| a.place.record / size == b.place.record / size && is_alike(a, b));
                    batches.into_iter().try_for_each(|batch| self.simulate(batch, simulator))?;
                }
            }
        }
        let done = self.done.fetch_add(records, Ordering::Relaxed) + records;
        self.observer.scenario_done(done);
        Ok(())
    }

    /// Returns whether a simulator has to run a record, one of these `places`: there are no rows of an
    /// earlier run, or, in a batch of an external simulator, none for some record of the batch. Batches are
    /// always repeated as a whole.
    fn is_needed(&self, place: RecordPosition, simulator: usize, places: &[RecordPosition]) -> bool {
        let lacks_rows = |place: &RecordPosition| !self.before.has(*place, simulator);
        match self.plan.simulators[simulator].batch(self.plan.spec.settings().entering) {
            None => lacks_rows(&place),
            Some(size) => {
                let of_batch = |other: &&RecordPosition| other.record / size == place.record / size;
                places.iter().filter(of_batch).any(lacks_rows)
            }
        }
    }

    /// Decodes a scenario and checks that it has an AV. `None` for a scenario that is skipped.
    fn prepare(&self, item: UndecodedRecord) -> Result<Option<PreparedScenario>, Refused> {
        let file = &self.plan.sources[item.place.input].file;
        let refuse = |id, error: String| Refused::Record(Box::new(Failure::new(item.place, file, id, error)));
        let decoded = item.content.and_then(UndecodedScenario::decode_with_digest);
        let (scenario, digest) = decoded.map_err(|e| refuse(e.scenario.clone(), e.to_string()))?;
        let selection = &self.plan.selection;
        if !selection.has_id(&scenario.id) {
            return Ok(self.unselected());
        }
        self.omissions.lock().read(self.plan, [&scenario.id]);
        let mut allowed = Vec::new();
        if self.plan.policy().is_some() {
            let found = self.plan.check_deviation(&scenario);
            allowed = self.allow("the file of deviations", &scenario.id, found).map_err(Refused::Run)?;
        }
        let given = Arc::default();
        match self.plan.checked_av(&scenario, &given) {
            Ok((_, deviation)) if !selection.has_category(deviation.category) => Ok(self.unselected()),
            Ok((av, deviation)) => {
                let is_judged = self.plan.policy().is_some_and(AvChoice::is_judged);
                let (place, digest) = (item.place, digest.unwrap_or_else(|| scenario.digest()));
                Ok(Some(PreparedScenario {
                    place,
                    digest,
                    av,
                    deviation,
                    allowed,
                    given,
                    av_map: is_judged.then(OnceLock::new),
                    scenario,
                }))
            }
            Err(NoAv::Missing) if !selection.has_category(None) => Ok(self.unselected()),
            Err(error) if self.plan.skips(&error) => {
                self.omissions.lock().passed_over += 1;
                Ok(None)
            }
            Err(error) => {
                let text = match error {
                    // It names the scenario.
                    NoAv::Planner(error) => error.to_string(),
                    error => format!("scenario `{}`: {error}", scenario.id),
                };
                let text = self.named(item.place, &text);
                Err(refuse(Some(scenario.id), text))
            }
        }
    }

    /// Returns the checks that motion given by `subject` fails.
    ///
    /// # Errors
    /// [`EvaluationError::Resumable`] if one of them is not allowed.
    fn allow(
        &self,
        subject: &str,
        scenario: &str,
        found: Vec<Finding>,
    ) -> Result<Vec<RolloutCheck>, EvaluationError> {
        let allowed = &self.plan.spec.subject.motion.allow;
        let missing: Vec<&Finding> =
            found.iter().filter(|finding| !allowed.contains(&finding.check)).collect();
        if missing.is_empty() {
            return Ok(found.into_iter().map(|finding| finding.check).collect());
        }
        let names: Vec<&str> = missing.iter().map(|finding| finding.check.allowance()).collect();
        let texts: Vec<&str> = missing.iter().map(|finding| finding.text.as_str()).collect();
        Err(EvaluationError::Resumable(format!(
            "stopped: the motion of {subject} cannot be judged as it is. Scenario `{scenario}`: {}. \
             Finished rows are kept: mend it and run again in a new folder, or continue with `allow` {}, \
             which marks its rows in every table",
            texts.join(". Also: "),
            names.join(",")
        )))
    }

    /// Counts a scenario that the selection leaves out.
    fn unselected(&self) -> Option<PreparedScenario> {
        self.omissions.lock().unselected += 1;
        None
    }

    fn simulate(&self, todo: &[&PreparedScenario], simulator: usize) -> Result<(), EvaluationError> {
        let planned = &self.plan.simulators[simulator];
        let mut finished: Vec<Vec<Rollout>> = todo.iter().map(|_| Vec::new()).collect();
        let mut failed: Vec<Option<String>> = vec![None; todo.len()];
        for rollout in 0..self.plan.spec.rollout.rollouts {
            let (mut requests, mut requested) = (Vec::new(), Vec::new());
            for (i, ready) in todo.iter().enumerate() {
                if failed[i].is_some() {
                    continue;
                }
                requests.push(Request { scenario: &ready.scenario, av: ready.av.clone(), rollout });
                requested.push(i);
            }
            let steps = requests.first().map_or(0, |request| request.scenario.length().future);
            let wanted = |step| {
                self.observer.stepped(step, steps);
                !self.stopped()
            };
            let settings = self.plan.spec.settings();
            let results = roll_out_while(requests, &planned.controller, &settings, &wanted);
            for (i, result) in requested.into_iter().zip(results) {
                match result {
                    Ok(done) => finished[i].push(done),
                    Err(error) => failed[i] = Some(error.to_string()),
                }
            }
        }
        // An interrupt ends simulators, too.
        let driver = self.plan.driver();
        let given_up = [(planned.id.clone(), planned.given_up())]
            .into_iter()
            .chain(driver.map(|driver| (driver.driver().to_string(), driver.given_up())))
            .find_map(|(name, reason)| Some((name, reason?)))
            .filter(|_| !self.is_interrupted());
        let mut stopped = None;
        for ((ready, rollouts), error) in todo.iter().zip(finished).zip(failed) {
            // Part of a batch that is repeated for another record.
            if self.before.has(ready.place, simulator) {
                continue;
            }
            match error {
                None => {
                    let mut rollouts = rollouts;
                    match self.mark(ready, simulator, &mut rollouts) {
                        Ok(()) => self.keep(ready, simulator, rollouts)?,
                        // The others of the batch are kept.
                        Err(error) => _ = stopped.get_or_insert(error),
                    }
                }
                // Not a result of this scenario: it runs again when the run is resumed.
                Some(_) if given_up.is_some() => {}
                // So it is with a rollout that was stopped, and with a simulator that was ended because it
                // did not answer in time.
                Some(_) if self.stopped() => {}
                Some(error) => self.fail_pair(ready, &planned.id, &error)?,
            }
        }
        if let Some((simulator, reason)) = given_up {
            return Err(EvaluationError::Resumable(format!(
                "stopped: `{simulator}` was given up: {reason}\nfinished rows are kept: mend it, and \
                 continue the run"
            )));
        }
        stopped.map_or(Ok(()), Err)
    }

    /// Checks the motion of an external simulator or planner, and marks rollouts that fail allowed checks.
    ///
    /// # Errors
    /// [`EvaluationError::Resumable`] if a check fails that is not allowed.
    fn mark(
        &self,
        ready: &PreparedScenario,
        simulator: usize,
        rollouts: &mut [Rollout],
    ) -> Result<(), EvaluationError> {
        let planned = &self.plan.simulators[simulator];
        let (without_av, history) = (self.plan.policy().is_some(), ready.scenario.length().history);
        for (index, rollout) in (0..).zip(rollouts) {
            let mut failed = ready.allowed.clone();
            if planned.external.is_some() {
                let given = CheckedScene::of_rollout(&ready.scenario, rollout, without_av);
                let subject = format!("`{}`", planned.id);
                failed.extend(self.allow(&subject, &ready.scenario.id, given.findings())?);
            }
            if let Some(driver) = self.plan.driver().filter(|driver| driver.is_foreign()) {
                let plans = ready.given.take(index);
                let mut found = CheckedScene::of_plans(&ready.scenario, &plans).plan_findings();
                let driven = CheckedScene::of_av(&ready.scenario, None, &rollout.tracks[0][history..]);
                let of_plans: Vec<RolloutCheck> = found.iter().map(|finding| finding.check).collect();
                found.extend(driven.findings().into_iter().filter(|f| !of_plans.contains(&f.check)));
                let subject = format!("`{}`", driver.driver());
                failed.extend(self.allow(&subject, &ready.scenario.id, found)?);
            }
            failed.sort();
            failed.dedup();
            rollout.outcomes.extend(failed.into_iter().map(|check| (check.outcome(), 1)));
        }
        Ok(())
    }

    /// Scores the rollouts of one scenario and one simulator, and writes the results.
    fn keep(
        &self,
        ready: &PreparedScenario,
        simulator: usize,
        rollouts: Vec<Rollout>,
    ) -> Result<(), EvaluationError> {
        let id = &self.plan.simulators[simulator].id;
        let certificate = ready.deviation.certificate.as_ref();
        let how = (&self.plan.metrics, self.plan.options);
        let scores = judge(&ready.scenario, certificate, &rollouts, how, ready.av_map.as_ref());
        if let Some(error) = scores.not_finite {
            return self.fail_pair(ready, id, &format!("scenario `{}`: {error}", ready.scenario.id));
        }
        let template = Row::about(ready.place, &ready.scenario, ready.digest.clone(), id)
            .with_deviation(&ready.deviation);
        let (rows, events) = scores.rows(template, &rollouts);
        if let Some(folder) = self.folder {
            if self.plan.spec.keeps_rollouts() {
                let part = folder.part(ready.place, simulator)?;
                rollouts::write_part(&part, &ready.scenario, id, &rollouts)?;
            }
            folder.append(&rows, &events)?;
        }
        self.observer.rows(&rows);
        self.tally.lock().add(&rows);
        Ok(())
    }

    /// Prefixes a text with file and record, like errors of files.
    fn named(&self, place: RecordPosition, text: &str) -> String {
        format!("{}: record {}: {text}", self.plan.sources[place.input].file.name, place.record)
    }

    /// Records the failure of a simulator in a scenario.
    fn fail_pair(
        &self,
        ready: &PreparedScenario,
        simulator: &str,
        error: &str,
    ) -> Result<(), EvaluationError> {
        let file = &self.plan.sources[ready.place.input].file;
        let error = self.named(ready.place, error);
        let failure = Failure::new(ready.place, file, Some(ready.scenario.id.clone()), error);
        self.fail(Failure { simulator: Some(simulator.to_owned()), ..failure })
    }

    fn fail(&self, failure: Failure) -> Result<(), EvaluationError> {
        self.observer.failed(&failure);
        let written = self.folder.map_or(Ok(()), |f| f.append_failure(&failure));
        self.failures.lock().push(failure);
        written
    }
}
