//! The JSON rollout document `reactsim-rollouts-v1`: scenarios with one judged rollout each, as any program
//! can write them.
//!
//! Unlike scenario files, a document is taken as it is: coordinates are not shifted, agents are neither
//! selected nor reordered, and their number is not limited.

mod read;
pub(crate) mod values;

use reactsim_scene::{Frame, LoggedAgent, RoadMap, SceneError};

/// Required value of the document's `format` field.
pub const FORMAT: &str = "reactsim-rollouts-v1";

/// A rollout document.
#[derive(Clone, Debug, PartialEq)]
pub struct Document {
    /// Names and values (as text) of the metric options set by the document, by name.
    pub options: Vec<(String, String)>,
    /// The scenarios, in order.
    pub scenarios: Vec<DocumentScenario>,
}

/// A scenario of a document.
#[derive(Clone, Debug, PartialEq)]
pub struct DocumentScenario {
    /// Id.
    pub id: String,
    /// Index of the current frame.
    pub current: usize,
    /// Number of frames after the current one.
    pub future: usize,
    /// Index of the AV in `agents`.
    pub av: usize,
    /// The map, limited to the elements that the metrics use.
    pub map: RoadMap,
    /// The agents with their judged tracks: `current + 1 + future` frames.
    pub agents: Vec<LoggedAgent>,
    /// The log, aligned with `agents`.
    pub log: Option<Vec<DocumentLog>>,
    /// Rollouts, each aligned with `agents`: `future` frames.
    pub rollouts: Vec<Vec<Vec<Frame>>>,
}

/// The log of one agent.
#[derive(Clone, Debug, PartialEq)]
pub struct DocumentLog {
    /// All frames.
    pub track: Vec<Frame>,
    /// x, y and heading up to the current frame, unchanged even at invalid frames; NaN for null.
    pub recorded_history: Vec<[f64; 3]>,
}

/// Error of reading a rollout document.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct DocumentError(pub String);

impl From<SceneError> for DocumentError {
    fn from(error: SceneError) -> Self {
        Self(error.to_string())
    }
}

impl Document {
    /// Reads a document.
    ///
    /// Unusual input: `null` in x, y or heading makes the frame invalid; `null` in vx or vy means an unknown
    /// velocity. Data of invalid frames and unknown successors and predecessors are ignored. An empty
    /// `drivable_area` means that there is none.
    ///
    /// # Errors
    /// [`DocumentError`] names scenario, agent, field and value: missing fields, arrays of the wrong length,
    /// numbers that are not finite at valid frames, repeated ids, an AV index without an agent, negative
    /// sizes.
    pub fn from_json(text: &str) -> Result<Self, DocumentError> {
        read::document(text)
    }
}
