//! Files in and out: scenario formats, deviations and rollouts.
//!
//! Reading is streaming: one scenario (of native files: one row group) is in memory at a time. Errors name file, record,
//! scenario, field and value; one bad record does not end a file, and one bad file does not end a folder.

mod error;
mod format;
mod json;
mod table;
mod womd;

pub mod document;
pub mod native;

pub use error::{Cause, FormatError};
pub use format::{FORMATS, Input, ScenarioFormat, Scenarios, find_inputs, open};
