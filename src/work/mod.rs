//! Distribution of work over threads. Results never depend on the number of threads.

#[cfg(feature = "work")]
mod pool;
mod threads;

#[cfg(feature = "work")]
pub use pool::Pool;
pub use threads::{MAX_THREADS, available_threads};
