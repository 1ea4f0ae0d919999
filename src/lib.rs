#![doc = include_str!("README.md")]
// Networks are deep types.
#![recursion_limit = "256"]
// Tests may ask the platform's functions: what they compare has a tolerance.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

extern crate self as reactsim;

pub mod geometry;
pub mod scene;

pub mod dynamics;

pub mod formats;
pub mod rollout;
pub mod training;
pub mod web;

pub mod generation;
pub mod metrics;

pub mod curation;
pub mod evaluation;

pub mod report;

pub mod benchmark;

pub mod cli;

pub use benchmark::{Benchmark, BenchmarkError, Results};

#[path = "../models/mod.rs"]
pub mod models;
