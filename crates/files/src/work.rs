//! Distribution of work over threads. Results never depend on the number of threads.

use std::num::NonZeroUsize;
use std::thread;

/// Largest number of threads that is ever started: more would only wait for each other.
pub const MAX_THREADS: usize = 512;

/// Returns the number of threads that run at the same time on this machine; 1 if it is unknown.
pub fn available_threads() -> usize {
    thread::available_parallelism().map_or(1, NonZeroUsize::get)
}

/// A pool of threads for parallel iterators.
#[derive(Debug)]
pub struct Pool(Option<rayon::ThreadPool>);

impl Pool {
    /// Starts `jobs` threads, at least 1 and at most [`MAX_THREADS`]. If the system does not grant them, the
    /// default pool does the work.
    pub fn new(jobs: usize) -> Self {
        Self(rayon::ThreadPoolBuilder::new().num_threads(jobs.clamp(1, MAX_THREADS)).build().ok())
    }

    /// Runs parallel work on the threads of the pool.
    pub fn install<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        match &self.0 {
            Some(pool) => pool.install(work),
            None => work(),
        }
    }
}
