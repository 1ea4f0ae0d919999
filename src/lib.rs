#![doc = include_str!("README.md")]
// Network types nest deeply.
#![recursion_limit = "256"]
// Tests may call the platform's math functions: their comparisons have tolerances.
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

pub mod cli;

#[path = "../models/mod.rs"]
pub mod models;
