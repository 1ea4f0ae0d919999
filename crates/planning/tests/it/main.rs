//! Comparison of the metrics with golden values of nuPlan's devkit.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod document;
mod golden_metrics;
