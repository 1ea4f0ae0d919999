//! Decisions made by hand, folded into a new file.

use std::path::Path;

use super::{InputFile, ReviewMark, ScenarioRecord, store};
use crate::formats::FormatError;

/// What counts for a scenario after all reviews.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decided {
    /// Who decided what: `pick`, `reject` or `flag`.
    pub mark: ReviewMark,
    /// Number of the candidate; `None` for the scenario as a whole.
    pub candidate: Option<u32>,
    /// Whether the decision is about the very trajectory that the record has under this number.
    pub fits: bool,
}

/// What became of decisions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Applied {
    /// Candidates that were picked.
    pub picked: usize,
    /// Of these, those that a filter had rejected.
    pub picked_rejected: usize,
    /// Scenarios that lost their candidate.
    pub dropped: usize,
    /// Decisions that changed nothing but the marks.
    pub marked: usize,
    /// Scenarios whose decision is about another trajectory: made for a file with other settings, and not applied.
    pub unfit: Vec<String>,
    /// Scenarios of the new file that have a candidate.
    pub chosen: usize,
}

/// Writes a file anew with the decisions folded in: a pick takes the place of the automatic choice, a rejected candidate leaves the set
/// (and no other takes its place), a flag keeps what is chosen. A decision about a
/// scenario as a whole is marked in all of its candidates. `decided` says what counts for a scenario, if anything does. Marks of
/// earlier decisions stay in scenarios about which nothing new was decided.
///
/// # Errors
/// [`FormatError`] when a file can not be read or written; then there is no new file.
pub fn apply(
    from: &Path,
    out: &Path,
    reviews: &[InputFile],
    mut decided: impl FnMut(&ScenarioRecord) -> Option<Decided>,
) -> Result<Applied, FormatError> {
    let records = store::read(from)?;
    let mut provenance = records.provenance().clone();
    let mut writer = store::Writer::create(out)?;
    let mut applied = Applied::default();
    for record in records {
        let mut record = record?;
        if let Some(decided) = decided(&record) {
            applied.one(&mut record, &decided);
        }
        applied.chosen += usize::from(record.chosen().is_some());
        writer.write(&record)?;
    }
    provenance.funnel.chosen = applied.chosen as u64;
    for review in reviews {
        if !provenance.reviews.contains(review) {
            provenance.reviews.push(review.clone());
        }
    }
    writer.finish(&provenance)?;
    Ok(applied)
}

impl Applied {
    /// Folds one decision into its scenario.
    fn one(&mut self, record: &mut ScenarioRecord, decided: &Decided) {
        let chosen = record.candidates.iter().position(|c| c.chosen);
        let named = decided.candidate.map(|n| record.candidates.iter().position(|c| c.candidate.number == n));
        let pick = decided.mark.decision == "pick";
        if !decided.fits || named == Some(None) || (pick && named.is_none()) {
            self.unfit.push(record.scenario_id.clone());
            return;
        }
        let whole = named.is_none();
        let at = named.flatten().or(chosen);
        for (i, candidate) in record.candidates.iter_mut().enumerate() {
            candidate.review = (whole || at == Some(i)).then(|| decided.mark.clone());
        }
        match (decided.mark.decision.as_str(), at) {
            ("pick", Some(at)) => {
                record.candidates.iter_mut().for_each(|c| c.chosen = false);
                record.candidates[at].chosen = true;
                self.picked += 1;
                self.picked_rejected += usize::from(record.candidates[at].rejected_by.is_some());
            }
            ("reject", Some(at)) if chosen == Some(at) => {
                record.candidates[at].chosen = false;
                self.dropped += 1;
            }
            _ => self.marked += 1,
        }
    }
}
