//! The decisions that are valid after all lines of all journals.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

use super::{ReviewLine, read};
use crate::review::{ReviewError, candidate_digest};
use crate::{Decision, ScenarioRecord};

/// Decisions by scenario id.
pub type Decisions = BTreeMap<String, Opinions>;

/// The last decision of each reviewer about one scenario, by name of the reviewer; includes cleared
/// decisions.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opinions(pub BTreeMap<String, ReviewLine>);

impl Opinions {
    /// Returns the decisions about a scenario of this digest that were not cleared, by name of the
    /// reviewer.
    pub fn standing<'a>(&'a self, digest: &'a str) -> impl Iterator<Item = &'a ReviewLine> {
        self.0.values().filter(move |l| l.decision != Decision::Clear && l.scenario_digest == digest)
    }

    /// Returns [`Self::standing`] without flags, which are no decisions.
    pub fn decided<'a>(&'a self, digest: &'a str) -> impl Iterator<Item = &'a ReviewLine> {
        self.standing(digest).filter(|l| l.decision != Decision::Flag)
    }

    /// Returns the decision that counts for a scenario of this digest: the latest. Of two at the same
    /// instant, that of the reviewer whose name sorts last.
    pub fn verdict<'a>(&'a self, digest: &'a str) -> Option<&'a ReviewLine> {
        latest(self.standing(digest))
    }

    /// Returns whether reviewers decided differently. A flag is never a disagreement.
    pub fn disagree(&self, digest: &str) -> bool {
        let mut views = self.decided(digest).map(|l| (l.decision, l.candidate));
        views.next().is_some_and(|first| views.any(|view| view != first))
    }

    /// Returns the decision about a scenario of this digest that more than half of its reviewers made, with
    /// or without a flag beside it: the latest line of those. `None` if there is no majority.
    pub fn majority<'a>(&'a self, digest: &'a str) -> Option<&'a ReviewLine> {
        let decided: Vec<&ReviewLine> = self.decided(digest).collect();
        let same = |l: &ReviewLine| {
            decided.iter().filter(|o| (o.decision, o.candidate) == (l.decision, l.candidate)).count()
        };
        let most = decided.iter().copied().filter(|l| 2 * same(l) > decided.len());
        latest(most)
    }

    /// Returns the decision for a record, by majority or the latest, and whether it refers to the trajectory
    /// that the record has under that number. If it does not, the file was made again with other settings,
    /// and the decision must not be applied.
    pub fn verdict_for<'a>(
        &'a self,
        record: &'a ScenarioRecord,
        by_majority: bool,
    ) -> Option<(&'a ReviewLine, bool)> {
        let digest = &record.scenario_digest;
        let line = if by_majority { self.majority(digest) } else { self.verdict(digest) };
        line.map(|line| (line, fits(line, record)))
    }

    /// Adds a line of the same journal, or a later one.
    pub fn take(&mut self, line: ReviewLine) {
        self.0.insert(line.reviewer.clone(), line);
    }

    /// Merges the final decisions of another journal: of the same reviewer's lines the later one counts.
    fn merge(&mut self, other: &Self) {
        for (reviewer, line) in &other.0 {
            match self.0.entry(reviewer.clone()) {
                Entry::Vacant(place) => {
                    place.insert(line.clone());
                }
                Entry::Occupied(mut place) if place.get().at < line.at => {
                    place.insert(line.clone());
                }
                Entry::Occupied(_) => {}
            }
        }
    }
}

/// Returns the latest line. Of two at the same instant, that of the reviewer whose name sorts last.
fn latest<'a>(lines: impl Iterator<Item = &'a ReviewLine>) -> Option<&'a ReviewLine> {
    lines.max_by(|a, b| a.at.cmp(&b.at).then_with(|| a.reviewer.cmp(&b.reviewer)))
}

/// Returns whether a line refers to a trajectory that the record has.
fn fits(line: &ReviewLine, record: &ScenarioRecord) -> bool {
    let Some(number) = line.candidate else {
        return true;
    };
    let same = |digest: &String, found: &str| digest == found;
    record.candidates.iter().map(|c| &c.candidate).find(|c| c.number == number).is_some_and(|c| {
        line.candidate_digest.as_ref().is_none_or(|digest| same(digest, &candidate_digest(c)))
    })
}

/// Merges the decisions of one journal into those of others.
pub(super) fn merge(all: &mut Decisions, other: &Decisions) {
    for (scenario, opinions) in other {
        all.entry(scenario.clone()).or_default().merge(opinions);
    }
}

/// Reads the decisions of several journals, together with warnings for the user; nothing is locked or
/// changed.
///
/// # Errors
/// When one cannot be read or has a line that is not a decision.
pub(super) fn of_files<P: AsRef<Path>>(paths: &[P]) -> Result<(Decisions, Vec<String>), ReviewError> {
    let (mut all, mut warnings) = (Decisions::new(), Vec::new());
    for path in paths {
        let found = read(path.as_ref())?;
        let mut own = Decisions::new();
        for line in found.lines {
            own.entry(line.scenario_id.clone()).or_default().take(line);
        }
        warnings.extend(found.warning);
        merge(&mut all, &own);
    }
    Ok((all, warnings))
}
