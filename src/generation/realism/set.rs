//! Measuring whole sets, scenarios side by side.

use rayon::prelude::*;

use super::{Tally, measure};
use crate::generation::in_order::{CHUNK, MOST_JOBS};
use crate::scene::Scenario;

/// A set of scenarios, measured. Memory does not grow with the set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Every other scenario, from the first one on, and the rest: what one half differs from the other by chance, another set may too.
    pub halves: [Tally; 2],
    /// Records that could not be read.
    pub failures: u64,
}

impl Measured {
    /// Reads and measures records on so many threads. The order of the records decides the result, the number of threads does not.
    /// Every error is counted, and handed to `failed` in the order of the records.
    pub fn of<F, E>(records: impl Iterator<Item = F>, jobs: usize, mut failed: impl FnMut(E)) -> Self
    where
        F: FnOnce() -> Result<Scenario, E> + Send,
        E: Send,
    {
        let jobs = jobs.clamp(1, MOST_JOBS);
        // Where the system grants no threads of our own, those that there are do the work.
        let pool = rayon::ThreadPoolBuilder::new().num_threads(jobs).build().ok();
        let mut set = Self::default();
        let mut records = records;
        loop {
            let chunk: Vec<F> = records.by_ref().take(jobs * CHUNK).collect();
            if chunk.is_empty() {
                return set;
            }
            let all = || -> Vec<Result<Tally, E>> {
                chunk.into_par_iter().map(|read| read().map(|scenario| measure(&scenario))).collect()
            };
            let done = match &pool {
                Some(pool) => pool.install(all),
                None => all(),
            };
            for tally in done {
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

    /// Adds a scenario to the half whose turn it is.
    fn add(&mut self, tally: &Tally) {
        let half = usize::from(self.halves[0].scenarios > self.halves[1].scenarios);
        self.halves[half].merge(tally);
    }

    /// Both halves together.
    pub fn whole(&self) -> Tally {
        let mut whole = self.halves[0].clone();
        whole.merge(&self.halves[1]);
        whole
    }
}
