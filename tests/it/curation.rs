//! Curation: the pipeline, files, analysis, the review page, command line.
#![allow(clippy::print_stdout, clippy::print_stderr, reason = "a test that is skipped says so")]

mod apply;
mod avoidance;
mod benchmark;
mod browser;
mod candidate_file;
mod choice;
mod cli;
mod filters;
mod hand;
mod lanes;
mod quota;
mod review;
mod road;
mod rules;
mod stats;
mod store;
mod taxonomy;
