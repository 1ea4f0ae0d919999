//! Settings and inputs that determine the results of runs in units.

use rayon::prelude::*;
use reactsim_formats::count_records;
use reactsim_shards::{RecordRange, ShardError, Unit};
use serde::{Deserialize, Serialize};

use crate::{EvaluationError, Plan, Provenance, StudyPlan};

/// Runs on the same sources, of which one is selected at a time.
pub trait Runs {
    /// Returns the number of runs.
    fn count(&self) -> usize;
    /// Switches to a run and returns its plan.
    fn select(&mut self, run: usize) -> &Plan;
}

impl Runs for Plan {
    fn count(&self) -> usize {
        1
    }

    fn select(&mut self, _: usize) -> &Plan {
        self
    }
}

impl Runs for StudyPlan {
    fn count(&self) -> usize {
        self.study().members.len()
    }

    fn select(&mut self, run: usize) -> &Plan {
        Self::select(self, run)
    }
}

/// Runs on the same sources that are divided into units: one run, or the members of a study.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardedRuns {
    /// The runs; at least one.
    pub runs: Vec<ShardedRun>,
}

/// A run that is divided into units.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ShardedRun {
    /// Its provenance.
    pub provenance: Provenance,
    /// Number of deviations in the file whose scenarios are selected by id.
    pub(super) deviations: usize,
}

impl ShardedRuns {
    /// Divides runs into units of this many records, or fewer at the end of a file. All files are read
    /// through once to count their records.
    ///
    /// # Errors
    /// [`EvaluationError::DividedBatch`] if units would divide batches of an external simulator.
    pub fn divide(
        runs: &mut dyn Runs,
        records: usize,
    ) -> Result<(Self, Vec<(usize, RecordRange)>), EvaluationError> {
        let sources = &runs.select(0).sources;
        let counts: Vec<usize> = sources.par_iter().map(|source| count_records(&source.open)).collect();
        let (mut sharded, mut ranges) = (Vec::new(), Vec::new());
        for part in 0..runs.count() {
            let plan = runs.select(part);
            for simulator in &plan.simulators {
                if let Some(batch) = simulator.batch().filter(|batch| !records.is_multiple_of(*batch)) {
                    let simulator = simulator.id.clone();
                    return Err(EvaluationError::DividedBatch { simulator, batch, records });
                }
            }
            let (provenance, deviations) = (plan.provenance(), plan.selected_deviations());
            sharded.push(ShardedRun { provenance, deviations });
            ranges.extend(RecordRange::divide(&counts, records).map(|range| (part, range)));
        }
        Ok((Self { runs: sharded }, ranges))
    }

    /// Checks that a run is the planned one, as far as the records of a unit are concerned.
    pub(super) fn check(&self, unit: &Unit, plan: &Plan) -> Result<(), ShardError> {
        let Some(run) = self.runs.get(unit.part) else {
            let (setting, planned) = ("number of runs".to_owned(), format!("above {}", unit.part));
            return Err(ShardError::OtherWork { setting, planned, now: self.runs.len().to_string() });
        };
        let mut now = plan.provenance();
        unit.trust_other_inputs(&run.provenance.inputs, &mut now.inputs);
        match run.provenance.difference(&now) {
            None => Ok(()),
            Some((setting, planned, now)) => Err(ShardError::OtherWork { setting, planned, now }),
        }
    }
}
