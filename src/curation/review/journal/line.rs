//! One decision, as a line of a journal.

use serde::{Deserialize, Serialize};

use crate::curation::review::{ReviewError, is_rfc3339};
use crate::curation::{Candidate, Decision, ReviewMark};

/// A line of a journal: who decided what, when.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReviewLine {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Digest of the scenario. Decisions about another content under the same id do not count.
    pub scenario_digest: String,
    /// Number of the candidate; `None` for the scenario as a whole.
    pub candidate: Option<u32>,
    /// [`candidate_digest`] of the candidate: after another curation its number may stand for another trajectory.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub candidate_digest: Option<String>,
    /// What was decided.
    pub decision: Decision,
    /// Name of the reviewer.
    pub reviewer: String,
    /// When: RFC 3339, UTC, with milliseconds.
    pub at: String,
    /// What the reviewer has to say.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Whether the line takes the reviewer's last one back, and says again what held before it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undo: bool,
}

/// Longest name of a reviewer and longest note, characters.
const LONGEST_NAME: usize = 100;
const LONGEST_NOTE: usize = 2000;

impl ReviewLine {
    /// Refuses what makes no sense.
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
        if self.reviewer.trim().is_empty() || self.reviewer.chars().count() > LONGEST_NAME {
            return refuse("`reviewer`", format!("`{}`", self.reviewer), "a name of at most 100 characters");
        }
        if !is_rfc3339(&self.at) {
            return refuse("`at`", format!("`{}`", self.at), "an instant such as 2026-03-01T12:00:00.000Z");
        }
        if self.decision == Decision::Pick && self.candidate.is_none() {
            return refuse("`candidate`", "null".to_owned(), "the number of the candidate that is picked");
        }
        if let Some(note) = self.note.as_ref().filter(|n| n.chars().count() > LONGEST_NOTE) {
            let found = format!("{} characters long", note.chars().count());
            return refuse("`note`", found, "at most 2000 characters");
        }
        Ok(())
    }

    /// What records keep of it.
    pub fn mark(&self) -> ReviewMark {
        ReviewMark { reviewer: self.reviewer.clone(), at: self.at.clone(), decision: self.decision }
    }
}

/// Digest of a candidate's trajectory: the first 16 hexadecimal digits of BLAKE3 over the 64-bit patterns of its states.
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
