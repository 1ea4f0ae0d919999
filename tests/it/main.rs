//! The integration tests: one binary.

mod cli;
mod evaluation;
mod generated;
