#![cfg_attr(feature = "report", doc = include_str!("README.md"))]
#![cfg_attr(
    not(feature = "models"),
    doc = "Traffic simulation benchmark; see the documentation with default features."
)]
// Network types nest deeply.
#![recursion_limit = "256"]
// Tests may call the platform's math functions: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

extern crate self as reactsim;

pub mod files;
pub mod geometry;
pub mod scene;
#[cfg(feature = "shards")]
pub mod shards;
pub mod work;

pub mod dynamics;

#[cfg(feature = "formats")]
pub mod formats;
pub mod rollout;
#[cfg(feature = "training")]
pub mod training;
#[cfg(feature = "web")]
pub mod web;

#[cfg(feature = "external")]
pub mod external;
#[cfg(feature = "generation")]
pub mod generation;
pub mod metrics;

#[cfg(feature = "curation")]
pub mod curation;
#[cfg(feature = "evaluation")]
pub mod evaluation;

#[cfg(feature = "report")]
pub mod report;

#[cfg(feature = "report")]
pub mod benchmark;

#[cfg(feature = "cli")]
pub mod cli;

#[cfg(feature = "report")]
pub use benchmark::{Benchmark, BenchmarkError, Results};

#[cfg(feature = "models")]
#[path = "../models/mod.rs"]
pub mod models;
