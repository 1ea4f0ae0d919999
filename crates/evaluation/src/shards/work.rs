//! Units of runs, carried out.

use std::cell::RefCell;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use reactsim_shards::{ShardError, ShardPlan, Unit, UnitResults, Work};

use super::{LEFT_OUT, Runs, ShardedRuns};
use crate::folder::{EVENTS, FAILURES, ROLLOUTS, ROWS, line};
use crate::runner::carry_out;
use crate::{EvaluationError, Execution, RunFolder, RunObserver, rollouts};

/// Runs, prepared in this process.
pub struct RunWork<'a> {
    runs: RefCell<Box<dyn Runs>>,
    planned: ShardedRuns,
    execution: Execution,
    observer: &'a dyn RunObserver,
    stop: &'a AtomicBool,
}

impl<'a> RunWork<'a> {
    /// Prepares units of `runs`, which must be the planned ones. Setting `stop` interrupts the work.
    pub fn new(
        runs: Box<dyn Runs>,
        planned: ShardedRuns,
        execution: Execution,
        observer: &'a dyn RunObserver,
        stop: &'a AtomicBool,
    ) -> Self {
        Self { runs: RefCell::new(runs), planned, execution, observer, stop }
    }

    fn write(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, EvaluationError> {
        let mut runs = self.runs.borrow_mut();
        let plan = runs.select(unit.part);
        let run = RunFolder::create(folder, &plan.provenance())?;
        let (range, tally) = (Some(unit.range), plan.tally());
        let done = carry_out(plan, range, self.execution, Some(&run), tally, self.observer, self.stop)?;
        let Some(mut results) = done else { return Ok(None) };
        results.failures.sort();
        run.finish(&results.tally, &results.failures)?;
        run.put(LEFT_OUT, &line(&results.left_out))?;
        let mut files = vec![ROWS, EVENTS, FAILURES, LEFT_OUT];
        if plan.keep_rollouts {
            rollouts::join_parts(&run, &results.tally)?;
            run.remove_parts()?;
            files.push(ROLLOUTS);
        }
        Ok(Some(UnitResults { records: results.records, failed: results.failures.len(), files }))
    }
}

impl Work for RunWork<'_> {
    fn check(&self, _: &ShardPlan, unit: &Unit) -> Result<(), ShardError> {
        self.planned.check(unit, self.runs.borrow_mut().select(unit.part))
    }

    fn carry_out(&self, unit: &Unit, folder: &Path) -> Result<Option<UnitResults>, ShardError> {
        self.write(unit, folder).map_err(ShardError::work)
    }
}
