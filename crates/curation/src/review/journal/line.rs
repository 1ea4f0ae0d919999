//! A decision as a line of a journal.

use serde::{Deserialize, Serialize};

use crate::review::{ReviewError, is_rfc3339};
use crate::{Candidate, Decision, ReviewMark};

/// A line of a journal: reviewer, decision and time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReviewLine {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Digest of the scenario. Decisions about other content under the same id do not count.
    pub scenario_digest: String,
    /// Number of the candidate; `None` for the scenario as a whole.
    pub candidate: Option<u32>,
    /// [`candidate_digest`] of the candidate: after another curation its number may refer to another
    /// trajectory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidate_digest: Option<String>,
    /// The decision.
    pub decision: Decision,
    /// Name of the reviewer.
    pub reviewer: String,
    /// Time of the decision, RFC 3339, UTC, with milliseconds.
    pub at: String,
    /// Note of the reviewer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Whether the line undoes the reviewer's last one and restates the decision before it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undo: bool,
}

/// Largest length of a reviewer's name, characters.
const MAX_NAME_LENGTH: usize = 100;
/// Largest length of a note, characters.
const MAX_NOTE_LENGTH: usize = 2000;

/// Returns whether a text can be the name of a reviewer. Names are printed, and are part of files.
pub fn is_reviewer(name: &str) -> bool {
    let length = name.chars().count();
    !name.trim().is_empty() && length <= MAX_NAME_LENGTH && !name.contains(char::is_control)
}

impl ReviewLine {
    /// Rejects invalid lines.
    ///
    /// # Errors
    /// [`ReviewError::Decision`] with the field.
    pub fn check(&self) -> Result<(), ReviewError> {
        let refuse = |field, value: String, expected: &str| {
            Err(ReviewError::Decision {
                scenario: self.scenario_id.clone(),
                field,
                value,
                expected: expected.to_owned(),
            })
        };
        if !is_reviewer(&self.reviewer) {
            let expected = "a name of at most 100 characters on one line";
            return refuse("`reviewer`", format!("`{}`", self.reviewer.escape_debug()), expected);
        }
        if !is_rfc3339(&self.at) {
            return refuse("`at`", format!("`{}`", self.at), "an instant such as 2026-03-01T12:00:00.000Z");
        }
        if self.decision == Decision::Pick && self.candidate.is_none() {
            return refuse("`candidate`", "null".to_owned(), "the number of the candidate that is picked");
        }
        if let Some(note) = self.note.as_ref().filter(|n| n.chars().count() > MAX_NOTE_LENGTH) {
            let found = format!("{} characters long", note.chars().count());
            return refuse("`note`", found, "at most 2000 characters");
        }
        Ok(())
    }

    /// Returns the part that records keep.
    pub fn mark(&self) -> ReviewMark {
        ReviewMark { reviewer: self.reviewer.clone(), at: self.at.clone(), decision: self.decision }
    }
}

/// Returns the digest of a candidate's trajectory: the first 16 hexadecimal digits of BLAKE3 over the
/// 64-bit patterns of its states.
pub fn candidate_digest(candidate: &Candidate) -> String {
    let mut hasher = blake3::Hasher::new();
    for state in &candidate.track {
        for value in [state.x, state.y, state.heading, state.vx, state.vy] {
            hasher.update(&value.to_bits().to_le_bytes());
        }
    }
    let mut digest = hasher.finalize().to_hex().to_string();
    digest.truncate(16);
    digest
}
