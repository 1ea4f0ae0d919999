//! Numbers of threads.

use std::num::NonZeroUsize;
use std::thread;

/// Largest number of threads that is ever started: more would only wait for each other.
pub const MAX_THREADS: usize = 512;

/// Returns the number of threads that run at the same time on this machine; 1 if it is unknown.
pub fn available_threads() -> usize {
    thread::available_parallelism().map_or(1, NonZeroUsize::get)
}
