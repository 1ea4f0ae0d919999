//! Curation: files, analysis, command line.

mod browser;
mod hand;
mod review;
mod store;
