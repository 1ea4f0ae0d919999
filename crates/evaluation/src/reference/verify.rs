//! Verification of a reference: its run is repeated and compared.

mod compare;

use std::sync::atomic::AtomicBool;

use parking_lot::Mutex;
use reactsim_nn::{Backend, cpu_class};

use super::{Reference, ReferenceError, RerunInputs, SimulatorClass};
use crate::plan::Plan;
use crate::row::{Failure, Row};
use crate::runner::{Execution, Outcome, RunObserver, run};
use crate::source::Source;
use crate::summary::Summary;

/// The comparison of a run with a reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Verification {
    /// Compared data.
    pub subject: Subject,
    /// Check of each simulator, in the order of the tables.
    pub simulators: Vec<SimulatorCheck>,
    /// All differences, in the order of simulators and scenarios.
    pub differences: Vec<Difference>,
    /// Number of rows (or summary values) of networks that a quick check left out.
    pub left_out: usize,
}

/// The data that is compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Every row.
    Rows,
    /// The values of the summary: the reference has no rows.
    Summary,
}

/// The comparison of the results of one simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatorCheck {
    /// Id of the simulator.
    pub id: String,
    /// Name of its class.
    pub class: &'static str,
    /// Whether the results must agree bit for bit on this machine.
    pub bit_for_bit: bool,
    /// Number of rows, or values of the summary, that were compared.
    pub compared: usize,
    /// Number of compared rows or values that differ.
    pub differing: usize,
    /// Number of rows or values that a quick check left out.
    pub left_out: usize,
    /// The largest difference of a metric; with bounds, the largest relative to its bound.
    pub largest: Option<LargestDifference>,
    /// Whether the results agree as closely as their class requires.
    pub passed: bool,
}

/// The largest difference of a metric.
#[derive(Clone, Debug, PartialEq)]
pub struct LargestDifference {
    /// Id of the metric.
    pub metric: String,
    /// Difference of two values, or mean paired difference if there is a bound.
    pub difference: f64,
    /// Bound, if any.
    pub bound: Option<f64>,
}

/// One value that differs.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Id of the simulator.
    pub simulator: String,
    /// Id of the scenario; `None` for a value over all of them.
    pub scenario: Option<String>,
    /// Index of the rollout; `None` for a value over all of them.
    pub rollout: Option<u32>,
    /// Id of the metric, or name of the field.
    pub field: String,
    /// Value in the reference.
    pub reference: String,
    /// Value of the run.
    pub found: String,
}

impl Difference {
    /// Creates the difference of a value over all scenarios.
    fn over_all(simulator: &str, field: String, reference: String, found: String) -> Self {
        Self { simulator: simulator.to_owned(), scenario: None, rollout: None, field, reference, found }
    }
}

impl SimulatorCheck {
    /// Begins the check of a simulator of this class, which must agree bit for bit if `exact`.
    fn of(id: &str, class: &SimulatorClass, exact: bool) -> Self {
        Self {
            id: id.to_owned(),
            class: class.name(),
            bit_for_bit: exact,
            compared: 0,
            differing: 0,
            left_out: 0,
            largest: None,
            passed: true,
        }
    }
}

impl Verification {
    fn of(subject: Subject) -> Self {
        Self { subject, simulators: Vec::new(), differences: Vec::new(), left_out: 0 }
    }

    /// Returns whether all compared results agree as closely as required.
    pub fn passed(&self) -> bool {
        self.simulators.iter().all(|s| s.passed)
    }
}

/// Repeats the run of a reference with its settings and compares by class. With `every`, a quick check:
/// simulators without a network on all scenarios, networks on every `every`th one. `None` if it was
/// interrupted.
///
/// # Errors
/// [`ReferenceError`] if this program or the inputs differ from those of the reference.
pub fn verify(
    reference: &Reference,
    inputs: RerunInputs,
    every: Option<usize>,
    execution: Execution,
    observer: &dyn RunObserver,
    stop: &AtomicBool,
) -> Result<Option<Verification>, ReferenceError> {
    let mut plan = reference.plan(inputs)?;
    let same_machine = reference.provenance.cpu.as_deref().is_none_or(|cpu| cpu == cpu_class())
        && reference.provenance.backend.as_deref().is_none_or(|own| own.parse::<Backend>().is_ok());
    let collector = RowCollector { inner: observer, rows: Mutex::default() };
    let carry_out = |plan: &Plan| run(plan, execution, None, plan.tally(), &collector, stop);
    let Some(every) = every else {
        let Outcome::Finished(summary) = carry_out(&plan)? else { return Ok(None) };
        return Ok(Some(match &reference.rows {
            Some(rows) => compare::rows(reference, rows, collector.take(1), 1, same_machine),
            None => compare::summaries(reference, Some(&summary), None, same_machine),
        }));
    };
    let every = every.max(1);
    let simulators = std::mem::take(&mut plan.simulators);
    let (networks, exact): (Vec<_>, Vec<_>) = simulators.into_iter().partition(|s| s.backend.is_some());
    let mut rows = Vec::new();
    let mut summary: Option<Box<Summary>> = None;
    plan.simulators = exact;
    if !plan.simulators.is_empty() {
        let Outcome::Finished(finished) = carry_out(&plan)? else { return Ok(None) };
        summary = Some(finished);
        rows.extend(collector.take(1));
    }
    let Some(expected) = &reference.rows else {
        if summary.is_none() {
            let reason = "a quick check would compare nothing: there are only aggregates of networks";
            return Err(ReferenceError::unfit(&reference.place, reason));
        }
        // Aggregates over part of the scenarios cannot be compared.
        let left_out: Vec<&str> = networks.iter().map(|s| s.id.as_str()).collect();
        return Ok(Some(compare::summaries(reference, summary.as_deref(), Some(&left_out), same_machine)));
    };
    plan.simulators = networks;
    if !plan.simulators.is_empty() {
        plan.sources = plan.sources.into_iter().map(|source| thinned(source, every)).collect();
        let Outcome::Finished(_) = carry_out(&plan)? else { return Ok(None) };
        rows.extend(collector.take(every));
    }
    Ok(Some(compare::rows(reference, expected, rows, every, same_machine)))
}

/// Returns a source with the first of every `every` scenarios.
fn thinned(source: Source, every: usize) -> Source {
    let Source { file, open, count } = source;
    let count = count.map(|count| count.div_ceil(every));
    Source { file, open: Box::new(move |first| Ok(Box::new(open(0)?.step_by(every).skip(first)))), count }
}

/// An observer that collects the rows of a run.
struct RowCollector<'a> {
    inner: &'a dyn RunObserver,
    rows: Mutex<Vec<Row>>,
}

impl RowCollector<'_> {
    /// Returns the rows since the last call, of a run on every `every`th scenario, with their original record
    /// indices.
    fn take(&self, every: usize) -> Vec<Row> {
        let mut rows = std::mem::take(&mut *self.rows.lock());
        rows.iter_mut().for_each(|row| row.record *= every);
        rows
    }
}

impl RunObserver for RowCollector<'_> {
    fn started(&self, total: Option<usize>) {
        self.inner.started(total);
    }

    fn stepped(&self, step: usize, steps: usize) {
        self.inner.stepped(step, steps);
    }

    fn scenario_done(&self, done: usize) {
        self.inner.scenario_done(done);
    }

    fn rows(&self, rows: &[Row]) {
        self.rows.lock().extend_from_slice(rows);
        self.inner.rows(rows);
    }

    fn failed(&self, failure: &Failure) {
        self.inner.failed(failure);
    }
}

/// Returns whether results of this class must agree bit for bit on this machine.
fn is_exact(class: &SimulatorClass, same_machine: bool) -> bool {
    same_machine || *class == SimulatorClass::Exact
}
