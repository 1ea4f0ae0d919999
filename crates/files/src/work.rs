//! Distribution of work over threads. Results never depend on the number of threads.

mod pool;
mod threads;

pub use pool::Pool;
pub use threads::{MAX_THREADS, available_threads};
