//! What holds after all lines of all journals.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::Path;

use super::{ReviewLine, read};
use crate::curation::review::{ReviewError, candidate_digest};
use crate::curation::{Decision, ScenarioRecord};

/// Decisions by scenario id.
pub type Decisions = BTreeMap<String, Opinions>;

/// What each reviewer decided last about one scenario, by name of the reviewer; cleared decisions among them.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Opinions(pub BTreeMap<String, ReviewLine>);

impl Opinions {
    /// The decisions about a scenario of this digest that were not cleared, by name of the reviewer.
    pub fn standing<'a>(&'a self, digest: &'a str) -> impl Iterator<Item = &'a ReviewLine> {
        self.0.values().filter(move |l| l.decision != Decision::Clear && l.scenario_digest == digest)
    }

    /// What counts for a scenario of this digest: the latest decision. Of two at the same instant that of the reviewer whose name
    /// sorts last.
    pub fn verdict<'a>(&'a self, digest: &'a str) -> Option<&'a ReviewLine> {
        self.standing(digest).max_by(|a, b| a.at.cmp(&b.at).then_with(|| a.reviewer.cmp(&b.reviewer)))
    }

    /// Whether reviewers decided differently. A flag is no decision here: it disagrees with nobody.
    pub fn disagree(&self, digest: &str) -> bool {
        let decided = |l: &&ReviewLine| l.decision != Decision::Flag;
        let mut views = self.standing(digest).filter(decided).map(|l| (l.decision, l.candidate));
        views.next().is_some_and(|first| views.any(|view| view != first))
    }

    /// [`Self::verdict`] for a record, and whether it is about the very trajectory that the record has under that number. A verdict
    /// that is not must not be applied: the file was made anew, with other settings.
    pub fn verdict_for<'a>(&'a self, record: &'a ScenarioRecord) -> Option<(&'a ReviewLine, bool)> {
        self.verdict(&record.scenario_digest).map(|line| (line, fits(line, record)))
    }

    /// Takes a line of the same journal, or one that came later.
    pub(super) fn take(&mut self, line: ReviewLine) {
        self.0.insert(line.reviewer.clone(), line);
    }

    /// Takes what another journal says at its end: of the same reviewer's lines the later one holds.
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

/// Whether a line is about a trajectory that the record has.
fn fits(line: &ReviewLine, record: &ScenarioRecord) -> bool {
    let Some(number) = line.candidate else {
        return true;
    };
    let same = |digest: &String, found: &str| digest == found;
    record.candidates.iter().map(|c| &c.candidate).find(|c| c.number == number).is_some_and(|c| {
        line.candidate_digest.as_ref().is_none_or(|digest| same(digest, &candidate_digest(c)))
    })
}

/// Adds the decisions of one journal to those of others.
pub(super) fn merge(all: &mut Decisions, other: &Decisions) {
    for (scenario, opinions) in other {
        all.entry(scenario.clone()).or_default().merge(opinions);
    }
}

/// The decisions of finished journals together; nothing is locked or changed. Second: what a user should be told.
///
/// # Errors
/// When one can not be read or holds a line that is no decision.
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
