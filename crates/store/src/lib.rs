//! Files behind URLs, read by a helper process.
//!
//! The helper is the Python module `reactsim.store`. It has the clients of object stores and their credentials (by
//! fsspec). It is started with the first URL, one per program, and answers requests in any order over its
//! standard input and output. The protocol is described in `python/reactsim/store.py`.

mod answer;
mod blocks;
mod client;
mod command;
mod connection;
mod remote_file;

pub use connection::interrupt;

/// Makes this program read URLs through the helper, unless it has another store.
pub fn install() {
    reactsim_files::set_store(client::HelperStore::shared());
}
