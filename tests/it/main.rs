//! All integration tests, in one binary.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]
#![allow(
    clippy::disallowed_methods,
    reason = "expected values may come from the platform: they have tolerances"
)]

mod animation;
mod attack;
mod batched_planning;
mod benchmark;
mod chromium;
mod circles;
mod cli;
mod compare;
mod ctg;
mod curation;
mod diffusion_planner;
mod evaluation;
mod external;
mod formats;
mod generate;
mod generated;
mod generation;
mod geometry_check;
mod guard;
mod hostile_input;
mod idm;
mod layers;
mod leaderboard;
mod metrics;
mod long_tables;
mod mini_scenarios;
mod model_weights;
mod networks;
mod ntp_reactive;
mod page;
mod parameters;
mod program;
mod protocol;
mod pufferdrive;
mod qp;
mod realism;
mod reference;
mod regression;
mod rollout_checks;
mod scenes;
mod scripted_av;
mod shard_commands;
mod shards;
mod shipped;
mod store;
mod study;
mod study_reference;
mod terminal;
mod tokens;
mod trained;
mod training;
mod variants;
mod vbd;
mod wosac;
mod smart_golden;
mod smart_rewards;
mod smart_simulator;
mod smart_training;

// Sources of the library that are compiled here again use the geometry by this path.
use reactsim::geometry;

/// Returns a path in the shared data if it exists; otherwise reports that the test is skipped.
#[track_caller]
pub(crate) fn shared(path: &str) -> Option<std::path::PathBuf> {
    let found = std::path::Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../shared")).join(path);
    if found.exists() {
        return Some(found);
    }
    skipped(&format!("no {path} beside the repository"));
    None
}

/// Reports that a test is skipped. Writes past the harness, which hides the output of tests that pass.
#[track_caller]
pub(crate) fn skipped(why: &str) {
    use std::io::Write;
    let at = std::panic::Location::caller();
    let test = std::thread::current().name().unwrap_or_default().to_owned();
    writeln!(std::io::stderr().lock(), "skipped: {test}: {why} ({}:{})", at.file(), at.line()).ok();
}
