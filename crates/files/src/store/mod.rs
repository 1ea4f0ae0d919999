//! Files behind URLs, which a helper process reads.
//!
//! The helper, `python -m reactsim.store`, knows object stores and their credentials (by fsspec). It is
//! started with the first URL, one per program, and answers requests in any order over its standard input and
//! output.
//! The protocol is described in `python/reactsim/store.py`.

mod answer;
mod blocks;
mod client;
mod command;
mod connection;
mod remote_file;

pub(super) use client::{Store, join};
pub use remote_file::RemoteFile;
