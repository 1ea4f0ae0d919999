//! Comparison of metrics, controllers and planners with golden values of public code, and of metrics with
//! arithmetic by hand.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod document;
mod drive;
mod golden_idm_agents;
mod golden_loop;
mod golden_metrics;
mod golden_pdm;
mod golden_tracking;
mod part;
mod rules;
