//! A pool of threads.

use super::MAX_THREADS;

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
