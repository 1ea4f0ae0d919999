//! What to run, the runner, results and their statistics.

pub mod document;
