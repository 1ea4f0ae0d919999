//! Curation: files, analysis, command line.

mod apply;
mod cli;
mod hand;
mod stats;
mod store;
