#![cfg_attr(feature = "report", doc = include_str!("README.md"))]
#![cfg_attr(
    not(feature = "models"),
    doc = "Traffic simulation benchmark; see the documentation with default features."
)]
// Network types nest deeply.
#![recursion_limit = "256"]
// Tests may call the platform's math functions: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

#[cfg(feature = "curation")]
#[doc(inline)]
pub use reactsim_curation as curation;
#[cfg(feature = "evaluation")]
#[doc(inline)]
pub use reactsim_evaluation as evaluation;
#[cfg(feature = "external")]
#[doc(inline)]
pub use reactsim_external as external;
#[doc(inline)]
pub use reactsim_files as files;
#[doc(inline)]
pub use reactsim_files::work;
#[cfg(feature = "formats")]
#[doc(inline)]
pub use reactsim_formats as formats;
#[cfg(feature = "generation")]
#[doc(inline)]
pub use reactsim_generation as generation;
#[doc(inline)]
pub use reactsim_geometry as geometry;
#[doc(inline)]
pub use reactsim_metrics as metrics;
#[cfg(feature = "models")]
#[doc(inline)]
pub use reactsim_models as models;
#[cfg(feature = "training")]
#[doc(inline)]
pub use reactsim_nn::training;
#[cfg(feature = "planning")]
#[doc(inline)]
pub use reactsim_planning as planning;
#[cfg(feature = "report")]
#[doc(inline)]
pub use reactsim_report as report;
#[cfg(feature = "report")]
#[doc(inline)]
pub use reactsim_report::web;
#[doc(inline)]
pub use reactsim_rollout as rollout;
#[doc(inline)]
pub use reactsim_scene as scene;
#[doc(inline)]
pub use reactsim_scene::dynamics;

#[cfg(feature = "report")]
pub mod benchmark;
#[cfg(feature = "cli")]
pub mod cli;
#[cfg(feature = "session")]
pub mod session;

/// Commit from which the program is built, with `+` if files were changed since; `unknown` outside a checkout.
#[cfg(feature = "report")]
const COMMIT: &str = match option_env!("REACTSIM_COMMIT") {
    Some(commit) => commit,
    None => "unknown",
};

#[cfg(feature = "report")]
pub use benchmark::{Benchmark, BenchmarkError, Results};

/// The examples of the README, which run as tests.
#[cfg(all(doctest, feature = "report"))]
#[doc = include_str!("../README.md")]
struct Readme;
