//! Comparison of the metrics with golden values of nuPlan's devkit, and with arithmetic by hand.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod document;
mod drive;
mod golden_metrics;
mod rules;
mod scene_history;
