//! Applies review decisions and writes a new file.

use std::path::Path;

use reactsim_formats::FormatError;

use super::decisions::{Decisions, ReviewLine};
use super::{Application, Decision, ScenarioRecord, store};

/// Result of applying decisions.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ApplyReport {
    /// Number of picked candidates.
    pub picked: usize,
    /// Number of picked candidates that a filter had rejected.
    pub picked_rejected: usize,
    /// Picks of candidates that a filter had rejected and that are not allowed: not applied.
    pub refused: Vec<RefusedPick>,
    /// Number of scenarios that lost their candidate.
    pub dropped: usize,
    /// Number of decisions that changed only the marks.
    pub marked: usize,
    /// Scenarios whose decision refers to another trajectory, from a file with other settings: not
    /// applied.
    pub unfit: Vec<String>,
    /// Number of scenarios with decisions that are not in the file, or whose content differs.
    pub unknown: usize,
    /// Number of scenarios in the new file.
    pub scenarios: usize,
    /// Number of scenarios in the new file that have a candidate.
    pub chosen: usize,
}

/// A pick that was not applied.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RefusedPick {
    /// Id of the scenario.
    pub scenario_id: String,
    /// Number of the candidate.
    pub candidate: u32,
    /// Id of the filter that had rejected it.
    pub rejected_by: String,
}

/// Writes a new file with the decisions applied.
///
/// A pick replaces the automatic choice, a rejected candidate leaves the set (and no other takes its
/// place), a flag keeps the choice. A decision about a scenario as a whole is marked in all of its
/// candidates. A pick of a candidate that a filter had rejected is not applied unless `application`
/// allows it: such a candidate may be unavoidable, or even infeasible.
///
/// Marks of earlier decisions stay in scenarios without a new decision. `application` is added to the
/// provenance.
///
/// # Errors
/// [`FormatError`] when a file cannot be read or written; then there is no new file.
pub fn apply(
    from: &Path,
    out: &Path,
    application: Application,
    decisions: &Decisions,
) -> Result<ApplyReport, FormatError> {
    let records = store::read(from)?;
    let mut provenance = records.provenance().clone();
    let mut writer = store::Writer::create(out)?;
    let mut applied = ApplyReport { unknown: decisions.scenarios(), ..ApplyReport::default() };
    for record in records {
        let mut record = record?;
        if let Some(line) = decisions.about(&record) {
            applied.unknown -= 1;
            applied.one(&mut record, line, application.allow_rejected);
        }
        applied.scenarios += 1;
        applied.chosen += usize::from(record.chosen().is_some());
        writer.write(&record)?;
    }
    provenance.funnel.chosen = applied.chosen as u64;
    provenance.applied.push(application);
    writer.finish(&provenance)?;
    Ok(applied)
}

impl ApplyReport {
    /// Applies one decision to its scenario.
    fn one(&mut self, record: &mut ScenarioRecord, line: &ReviewLine, allow_rejected: bool) {
        let decision = line.decision;
        let chosen = record.candidates.iter().position(|c| c.chosen);
        let named = line.candidate.map(|n| record.candidates.iter().position(|c| c.candidate.number == n));
        if !line.fits(record) || (decision == Decision::Pick && named.is_none()) {
            self.unfit.push(record.scenario_id.clone());
            return;
        }
        let whole = named.is_none();
        let at = named.flatten().or(chosen);
        if let (Decision::Pick, Some(at)) = (decision, at)
            && let Some(filter) = &record.candidates[at].rejected_by
        {
            if !allow_rejected {
                self.refused.push(RefusedPick {
                    scenario_id: record.scenario_id.clone(),
                    candidate: record.candidates[at].candidate.number,
                    rejected_by: filter.clone(),
                });
                return;
            }
            self.picked_rejected += 1;
        }
        match (decision, at) {
            // A cleared decision changes nothing.
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
            candidate.review = (whole || at == Some(i)).then(|| line.mark());
        }
    }
}
