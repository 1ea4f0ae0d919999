//! Decisions of reviewers: JSON lines that the review page exports.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::{Candidate, Decision, ReviewMark, ScenarioRecord};

/// A decision about a scenario.
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
    /// Time of the decision, RFC 3339, UTC, with milliseconds: such texts sort like the instants.
    pub at: String,
    /// Note of the reviewer.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub note: Option<String>,
    /// Whether the line restates an earlier decision; in journals of earlier versions of the program.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub undo: bool,
}

/// Error of a file of decisions.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct DecisionError(pub String);

/// Largest length of a reviewer's name, characters.
const MAX_NAME_LENGTH: usize = 100;

impl ReviewLine {
    /// Returns what is wrong with the line.
    fn problem(&self) -> Option<String> {
        let Self { reviewer, at, .. } = self;
        let is_name = !reviewer.trim().is_empty()
            && reviewer.chars().count() <= MAX_NAME_LENGTH
            && !reviewer.contains(char::is_control);
        if !is_name {
            let name = reviewer.escape_debug();
            return Some(format!(
                "`reviewer` is `{name}`, expected a name of 1 to 100 characters on one line"
            ));
        }
        if !is_instant(at) {
            return Some(format!("`at` is `{at}`, expected an instant such as 2026-03-01T12:00:00.000Z"));
        }
        (self.decision == Decision::Pick && self.candidate.is_none())
            .then(|| "`candidate` is null, expected the number of the candidate that is picked".to_owned())
    }

    /// Returns the part that records keep.
    pub fn mark(&self) -> ReviewMark {
        ReviewMark { reviewer: self.reviewer.clone(), at: self.at.clone(), decision: self.decision }
    }

    /// Returns whether the line refers to a trajectory that the record has.
    pub(super) fn fits(&self, record: &ScenarioRecord) -> bool {
        self.candidate.is_none_or(|number| {
            let found = record.candidates.iter().map(|c| &c.candidate).find(|c| c.number == number);
            let same = |c| self.candidate_digest.as_ref().is_none_or(|digest| *digest == candidate_digest(c));
            found.is_some_and(same)
        })
    }
}

/// Returns whether a text has the form of an instant: `2026-03-01T12:00:00.000Z`.
fn is_instant(text: &str) -> bool {
    let shape = b"dddd-dd-ddTdd:dd:dd.dddZ";
    let fits = |(found, expected): (u8, &u8)| match expected {
        b'd' => found.is_ascii_digit(),
        other => found == *other,
    };
    text.len() == shape.len() && text.bytes().zip(shape).all(fits)
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

/// The last decision of each reviewer about each scenario, by id of the scenario and name of the reviewer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Decisions(BTreeMap<String, BTreeMap<String, ReviewLine>>);

impl Decisions {
    /// Reads files of decisions. Of a reviewer's lines about a scenario, the last one in a file counts, and
    /// the one with the latest time among files.
    ///
    /// # Errors
    /// [`DecisionError`] if a file cannot be read or has a line that is not a decision.
    pub fn read<P: AsRef<Path>>(paths: &[P]) -> Result<Self, DecisionError> {
        let mut all = Self::default();
        for path in paths {
            let path = path.as_ref();
            let text = fs::read_to_string(path).map_err(|e| {
                DecisionError(format!("could not read the decisions in {}: {e}", path.display()))
            })?;
            let mut own = BTreeMap::new();
            for (i, line) in text.lines().enumerate().filter(|(_, line)| !line.trim().is_empty()) {
                let refuse = |found: String| {
                    let (path, line) = (path.display(), i + 1);
                    DecisionError(format!("{path}, line {line}: {found}; repair or remove this line"))
                };
                let line: ReviewLine =
                    serde_json::from_str(line).map_err(|e| refuse(format!("not a decision: {e}")))?;
                line.problem().map_or(Ok(()), |found| Err(refuse(found)))?;
                own.insert((line.scenario_id.clone(), line.reviewer.clone()), line);
            }
            own.into_values().for_each(|line| all.add(line));
        }
        // A decision that was withdrawn is none.
        for lines in all.0.values_mut() {
            lines.retain(|_, line| line.decision != Decision::Clear);
        }
        all.0.retain(|_, lines| !lines.is_empty());
        Ok(all)
    }

    /// Adds a decision, unless there is a later one of the same reviewer about the same scenario.
    pub fn add(&mut self, line: ReviewLine) {
        let lines = self.0.entry(line.scenario_id.clone()).or_default();
        if lines.get(&line.reviewer).is_none_or(|earlier| earlier.at < line.at) {
            lines.insert(line.reviewer.clone(), line);
        }
    }

    /// Returns the decision that counts for a scenario: the latest about its content. Of two at the same
    /// instant, that of the reviewer whose name sorts last.
    pub fn about(&self, record: &ScenarioRecord) -> Option<&ReviewLine> {
        let lines = self.0.get(&record.scenario_id)?.values();
        lines.filter(|l| l.scenario_digest == record.scenario_digest).max_by(|a, b| a.at.cmp(&b.at))
    }

    /// Returns the number of scenarios with decisions.
    pub fn scenarios(&self) -> usize {
        self.0.len()
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    fn line(scenario: &str, decision: &str, reviewer: &str, second: u32) -> String {
        format!(
            r#"{{"scenario_id":"{scenario}","scenario_digest":"d","candidate":1,"decision":"{decision}","reviewer":"{reviewer}","at":"2026-01-01T12:00:{second:02}.000Z"}}"#
        ) + "\n"
    }

    fn read(files: &[String]) -> Result<Decisions, DecisionError> {
        let folder = tempfile::tempdir().unwrap();
        let write = |(i, text): (usize, &String)| {
            let path = folder.path().join(format!("{i}.jsonl"));
            fs::write(&path, text).unwrap();
            path
        };
        Decisions::read(&files.iter().enumerate().map(write).collect::<Vec<_>>())
    }

    fn verdict(decisions: &Decisions, id: &str, digest: &str) -> Option<(Decision, String)> {
        let record = ScenarioRecord {
            scenario_id: id.to_owned(),
            scenario_digest: digest.to_owned(),
            origin: Vec2::new(0.0, 0.0),
            candidates: Vec::new(),
            scene: None,
        };
        decisions.about(&record).map(|line| (line.decision, line.reviewer.clone()))
    }

    #[test]
    fn the_latest_decision_counts() {
        let anna = line("a", "pick", "anna", 5)
            + &line("a", "reject", "anna", 3)
            + "\n"
            + &line("b", "flag", "anna", 1);
        let ben = line("a", "pick", "ben", 4) + &line("b", "pick", "ben", 1) + &line("b", "clear", "ben", 2);
        let both = read(&[anna.clone(), ben.clone()]).unwrap();
        assert_eq!(both, read(&[ben, anna]).unwrap());
        // The last line of a journal counts, whatever its time.
        assert_eq!(verdict(&both, "a", "d"), Some((Decision::Pick, "ben".into())));
        assert_eq!(verdict(&both, "b", "d"), Some((Decision::Flag, "anna".into())));
        assert_eq!((verdict(&both, "a", "other"), both.scenarios()), (None, 2));
    }

    #[test]
    fn lines_that_are_no_decisions_are_refused() {
        let good = line("a", "pick", "anna", 1);
        assert!(read(&[good.replace("}\n", ",\"undo\":true,\"note\":\"n\"}\n")]).is_ok());
        for (bad, found) in [
            (good.replace("pick", "love"), "not a decision: unknown variant"),
            (good.replace("anna", "a\\nb"), "`reviewer` is `a\\nb`"),
            (good.replace("anna", " "), "expected a name of 1 to 100 characters"),
            (good.replace(":1,", ":null,"), "`candidate` is null"),
            (good.replace("000Z", "0Z"), "`at` is `2026-01-01T12:00:01.0Z`"),
            (good.replace("scenario_id", "id"), "unknown field"),
            (good[..40].to_owned(), "not a decision: EOF"),
        ] {
            let error = read(&[good.clone() + &bad]).unwrap_err().to_string();
            assert!(error.contains("0.jsonl, line 2: ") && error.contains(found), "{error}");
        }
    }
}
