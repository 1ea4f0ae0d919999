//! Decisions made by hand, folded into a new file.

use std::path::Path;

use super::{Application, Decision, ReviewMark, ScenarioRecord, store};
use crate::formats::FormatError;

/// What counts for a scenario after all reviews.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Decided {
    /// Who decided what.
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
    /// Picks of candidates that a filter had rejected, where these are not allowed: not applied.
    pub refused: Vec<Refused>,
    /// Scenarios that lost their candidate.
    pub dropped: usize,
    /// Decisions that changed nothing but the marks.
    pub marked: usize,
    /// Scenarios whose decision is about another trajectory: made for a file with other settings, and not applied.
    pub unfit: Vec<String>,
    /// Scenarios of the new file that have a candidate.
    pub chosen: usize,
}

/// A pick that is not applied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Number of the candidate.
    pub candidate: u32,
    /// Id of the filter that had rejected it.
    pub rejected_by: String,
}

/// Writes a file anew with the decisions folded in: a pick takes the place of the automatic choice, a rejected candidate leaves the set
/// (and no other takes its place), a flag keeps what is chosen. A decision about a
/// scenario as a whole is marked in all of its candidates. A pick of a candidate that a filter had rejected is not applied, unless
/// `application` allows it: such a candidate need not be avoidable, or not even feasible. `decided` says what counts for a scenario, if
/// anything does. Marks of earlier decisions stay in scenarios about which nothing new was decided.
///
/// `application` is added to the provenance.
///
/// # Errors
/// [`FormatError`] when a file can not be read or written; then there is no new file.
pub fn apply(
    from: &Path,
    out: &Path,
    application: Application,
    mut decided: impl FnMut(&ScenarioRecord) -> Option<Decided>,
) -> Result<Applied, FormatError> {
    let records = store::read(from)?;
    let mut provenance = records.provenance().clone();
    let mut writer = store::Writer::create(out)?;
    let mut applied = Applied::default();
    for record in records {
        let mut record = record?;
        if let Some(decided) = decided(&record) {
            applied.one(&mut record, &decided, application.allow_rejected);
        }
        applied.chosen += usize::from(record.chosen().is_some());
        writer.write(&record)?;
    }
    provenance.funnel.chosen = applied.chosen as u64;
    provenance.applied.push(application);
    writer.finish(&provenance)?;
    Ok(applied)
}

impl Applied {
    /// Folds one decision into its scenario.
    fn one(&mut self, record: &mut ScenarioRecord, decided: &Decided, allow_rejected: bool) {
        let decision = decided.mark.decision;
        let chosen = record.candidates.iter().position(|c| c.chosen);
        let named = decided.candidate.map(|n| record.candidates.iter().position(|c| c.candidate.number == n));
        if !decided.fits || named == Some(None) || (decision == Decision::Pick && named.is_none()) {
            self.unfit.push(record.scenario_id.clone());
            return;
        }
        let whole = named.is_none();
        let at = named.flatten().or(chosen);
        if let (Decision::Pick, Some(at)) = (decision, at)
            && let Some(filter) = &record.candidates[at].rejected_by
        {
            if !allow_rejected {
                self.refused.push(Refused {
                    scenario_id: record.scenario_id.clone(),
                    candidate: record.candidates[at].candidate.number,
                    rejected_by: filter.clone(),
                });
                return;
            }
            self.picked_rejected += 1;
        }
        match (decision, at) {
            // Nothing was decided after all: what is there stays.
            (Decision::Clear, _) => return,
            (Decision::Pick, Some(at)) => {
                record.candidates.iter_mut().for_each(|c| c.chosen = false);
                record.candidates[at].chosen = true;
                self.picked += 1;
            }
            (Decision::Reject, Some(at)) if chosen == Some(at) => {
                record.candidates[at].chosen = false;
                self.dropped += 1;
            }
            (Decision::Pick | Decision::Reject | Decision::Flag, _) => self.marked += 1,
        }
        for (i, candidate) in record.candidates.iter_mut().enumerate() {
            candidate.review = (whole || at == Some(i)).then(|| decided.mark.clone());
        }
    }
}
