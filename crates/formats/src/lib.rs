//! File input and output: scenario formats, deviations, rollouts and rollout documents.
//!
//! Reading is streaming: one scenario (for native files: one row group) is in memory at a time. Errors name
//! file, record, scenario, field and value. A bad record does not stop reading of its file, and a bad file
//! does not stop reading of its folder.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod certificates;
pub mod error;
mod crop;
mod format;
mod frames;
mod argoverse2;
mod gpudrive;
mod json;
mod list;
mod nuplan;
mod pickle;
mod scenarionet;
mod sketch;
mod states;
pub mod table;
pub mod wire;
mod womd;

pub mod deviations;
pub mod document;
pub mod native;
mod partition;
pub mod reactsim_bench;
pub mod rollouts;
pub mod wosac;

pub use crop::crop;
pub use error::{Cause, FormatError};
pub use format::{
    Opener, PendingScenarios, ScenarioFormat, Scenarios, UndecodedScenario, count_records, decoded,
    is_parquet,
};
pub use frames::{CurrentFrames, FutureChoice, LengthChoice, ParseFutureError};
pub use json::parse as parse_json;
pub use list::{FORMATS, Input, PassedOver, Survey, find_inputs, open, open_all, survey};
pub use nuplan::nuplan_filter;
pub use partition::Partition;
pub use sketch::{SKETCH_VERSION, sketch};
pub use womd::record::tf_record;

#[cfg(test)]
mod length_tests;
