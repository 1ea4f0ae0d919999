//! All integration tests, in one binary.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod cli;
mod curation;
mod evaluation;
mod formats;
mod generated;
mod idm;
mod layers;
mod metrics;
mod mini_scenarios;
mod protocol;
mod scenes;
mod scripted_av;

/// Where the shared data lie, if they are there; a test that needs them is passed over otherwise.
pub(crate) fn shared(path: &str) -> Option<std::path::PathBuf> {
    let path = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared")).join(path);
    path.exists().then_some(path)
}
