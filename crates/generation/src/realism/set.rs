//! Parallel measurement of whole sets.

use rayon::prelude::*;
use reactsim_scene::Scenario;
use reactsim_work::{MAX_THREADS, Pool};

use super::{Tally, measure};
use crate::in_order::CHUNK_PER_JOB;

/// Statistics of a set of scenarios. Memory does not grow with the set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Every other scenario, from the first one on, and the rest: the difference between the halves shows
    /// the effect of chance.
    pub halves: [Tally; 2],
    /// Number of records that could not be read.
    pub failures: u64,
}

impl Measured {
    /// Reads and measures records on `jobs` threads. The result depends on the order of the records, not on
    /// the number of threads. Every error is counted, and passed to `failed` in the order of the records.
    pub fn of<F, E>(records: impl Iterator<Item = F>, jobs: usize, mut failed: impl FnMut(E)) -> Self
    where
        F: FnOnce() -> Result<Scenario, E> + Send,
        E: Send,
    {
        let jobs = jobs.clamp(1, MAX_THREADS);
        let pool = Pool::new(jobs);
        let mut set = Self::default();
        let mut records = records;
        loop {
            let chunk: Vec<F> = records.by_ref().take(jobs * CHUNK_PER_JOB).collect();
            if chunk.is_empty() {
                return set;
            }
            let all = || -> Vec<Result<Tally, E>> {
                chunk.into_par_iter().map(|read| read().map(|scenario| measure(&scenario))).collect()
            };
            for tally in pool.install(all) {
                match tally {
                    Ok(tally) => set.add(&tally),
                    Err(error) => {
                        set.failures += 1;
                        failed(error);
                    }
                }
            }
        }
    }

    /// Adds a scenario to the halves in turn.
    fn add(&mut self, tally: &Tally) {
        let half = usize::from(self.halves[0].scenarios > self.halves[1].scenarios);
        self.halves[half].merge(tally);
    }

    /// Returns both halves merged.
    pub fn whole(&self) -> Tally {
        let mut whole = self.halves[0].clone();
        whole.merge(&self.halves[1]);
        whole
    }
}
