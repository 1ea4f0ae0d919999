//! Curation: files, analysis, command line.

mod apply;
mod browser;
mod cli;
mod hand;
mod review;
mod stats;
mod store;
