//! Curation: files, analysis, command line.

mod hand;
mod store;
