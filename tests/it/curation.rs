//! Curation: files, analysis, the review page, command line.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a test that is skipped says so")]

mod apply;
mod browser;
mod cli;
mod hand;
mod review;
mod stats;
mod store;
