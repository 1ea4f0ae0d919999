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
mod cli;
mod compare;
mod ctg;
mod curation;
mod diffusion_planner;
mod document;
mod documents;
mod evaluation;
mod external;
mod formats;
mod small_scenarios;
mod generation;
mod ground;
mod guard;
mod idm;
mod import;
mod leaderboard;
mod levels;
mod long_logs;
mod long_tables;
mod metric_constants;
mod mini_scenarios;
mod mix;
mod model_weights;
mod networks;
mod ntp_reactive;
mod official;
mod own_metrics;
mod page;
mod planners;
mod parameters;
mod partitions;
mod program;
mod protocol;
mod pufferdrive;
mod qp;
mod qp_regression;
mod realism_rewards;
mod reference;
mod rollout_checks;
mod scenes;
mod scripted_av;
mod shipped;
mod study;
mod study_reference;
mod terminal;
mod tokens;
mod trained;
mod variants;
mod vbd;
mod wosac;
mod smart_golden;
mod smart_rewards;
mod smart_simulator;
mod smart_training;

use reactsim_test_support::{shared, skipped};
