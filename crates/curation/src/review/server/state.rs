//! State of a review: the file, the journal, and the reviewer.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::Decision;
use crate::review::page::{DecisionStatus, Overview, scenario_json};
use crate::review::{
    Agreement, Clock, Journal, ReviewError, ReviewLine, ReviewOptions, candidate_digest, is_reviewer, rfc3339,
};
use crate::store::Store;

/// State of a review.
pub(super) struct ReviewState {
    store: Store,
    journal: Journal,
    reviewer: Option<String>,
    suggestion: String,
    clock: Clock,
    /// Candidate digests of the scenarios shown so far, by scenario number and candidate number.
    digests: BTreeMap<usize, BTreeMap<u32, String>>,
}

/// Decision that the page asks to record.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DecisionRequest {
    /// Number of the scenario in the file.
    index: usize,
    candidate: Option<u32>,
    decision: Decision,
    #[serde(default)]
    note: Option<String>,
}

/// Data that the page loads first.
#[derive(Serialize)]
struct Session<'a> {
    file: String,
    journal: String,
    reviewer: Option<&'a str>,
    suggestion: &'a str,
    warnings: &'a [String],
    overview: Overview,
    standings: Vec<DecisionStatus>,
    /// Agreement of several reviewers in words.
    agreement: Option<String>,
}

impl ReviewState {
    pub(super) fn new(store: Store, journal: Journal, options: ReviewOptions) -> Self {
        let ReviewOptions { reviewer, suggestion, clock, .. } = options;
        let reviewer = reviewer.map(|name| name.trim().to_owned()).filter(|name| is_reviewer(name));
        let suggestion = journal.last_reviewer().map_or(suggestion, str::to_owned);
        Self { store, journal, reviewer, suggestion, clock, digests: BTreeMap::new() }
    }

    /// Returns warnings to show before the review begins.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings = self.journal.warnings().to_vec();
        let decisions = self.journal.decisions();
        let unknown = decisions.keys().filter(|id| self.store.find(id).is_none()).count();
        if unknown > 0 {
            warnings.push(format!("{unknown} scenarios with decisions are not in this file"));
        }
        let is_foreign = |(id, digest): (&String, &str)| {
            let entry = self.store.find(id).map(|i| &self.store.scenarios()[i]);
            entry.is_some_and(|e| e.scenario_digest != digest)
        };
        let lines = decisions.iter().flat_map(|(id, o)| o.0.values().map(move |l| (id, l)));
        let foreign = lines.filter(|(id, l)| is_foreign((id, &l.scenario_digest))).count();
        if foreign > 0 {
            warnings.push(format!(
                "{foreign} decisions are about scenarios whose content has since changed; they do not count"
            ));
        }
        warnings
    }

    /// Returns the data that the page needs before the first scenario.
    pub(super) fn session(&self) -> Result<String, ReviewError> {
        let decisions = self.journal.decisions();
        let entries = self.store.scenarios();
        let standings = entries.iter().enumerate().filter_map(|(index, entry)| {
            let standing =
                DecisionStatus::new(index, decisions.get(&entry.scenario_id)?, &entry.scenario_digest);
            (!standing.is_empty()).then_some(standing)
        });
        let name = |path: &std::path::Path| {
            path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
        };
        json(&Session {
            file: name(self.store.path()),
            journal: self.journal.path().display().to_string(),
            reviewer: self.reviewer.as_deref(),
            suggestion: &self.suggestion,
            warnings: &self.warnings(),
            overview: Overview::new(entries),
            standings: standings.collect(),
            agreement: Agreement::about(entries, &decisions).map(|agreement| agreement.to_string()),
        })
    }

    /// Returns a scenario by its number; `None` if the number is out of range.
    pub(super) fn scenario(&mut self, index: usize) -> Option<Result<String, ReviewError>> {
        let entry = self.store.scenarios().get(index)?;
        let opinions = self.journal.opinions(&entry.scenario_id);
        Some(self.store.scenario(index).map_err(ReviewError::from).and_then(|record| {
            let digests = record.candidates.iter().map(|c| &c.candidate);
            self.digests.insert(index, digests.map(|c| (c.number, candidate_digest(c))).collect());
            scenario_json(index, &record, &opinions)
                .map_err(|e| ReviewError::Encode { scenario: record.scenario_id.clone(), source: e })
        }))
    }

    /// Sets the reviewer.
    pub(super) fn set_reviewer(&mut self, name: &str) -> Result<String, ReviewError> {
        let name = name.trim();
        if !is_reviewer(name) {
            return Err(ReviewError::Reviewer { name: name.escape_debug().to_string() });
        }
        self.reviewer = Some(name.to_owned());
        json(&self.reviewer)
    }

    /// Records a decision. Returns the new status of its scenario.
    pub(super) fn decide(&mut self, request: DecisionRequest) -> Result<String, ReviewError> {
        let reviewer = self.reviewer()?;
        let Some(entry) = self.store.scenarios().get(request.index).cloned() else {
            return Err(ReviewError::Decision {
                scenario: request.index.to_string(),
                field: "`index`",
                value: request.index.to_string(),
                expected: format!("below {}", self.store.scenarios().len()),
            });
        };
        let candidate_digest = match request.candidate {
            Some(number) => Some(self.digest(request.index, &entry.scenario_id, number)?),
            None => None,
        };
        self.journal.append(ReviewLine {
            scenario_id: entry.scenario_id,
            scenario_digest: entry.scenario_digest,
            candidate: request.candidate,
            candidate_digest,
            decision: request.decision,
            reviewer,
            at: rfc3339((self.clock)()),
            note: request.note.filter(|note| !note.trim().is_empty()),
            undo: false,
        })?;
        self.standing(request.index)
    }

    /// Undoes the reviewer's last decision. Returns the new status of its scenario, or `null` if there
    /// was none.
    pub(super) fn undo(&mut self) -> Result<String, ReviewError> {
        let reviewer = self.reviewer()?;
        let line = self.journal.undo(&reviewer, rfc3339((self.clock)()))?;
        match line.and_then(|line| self.store.find(&line.scenario_id)) {
            Some(index) => self.standing(index),
            None => Ok("null".to_owned()),
        }
    }

    fn reviewer(&self) -> Result<String, ReviewError> {
        self.reviewer.clone().ok_or_else(|| ReviewError::Reviewer { name: String::new() })
    }

    /// Returns the digest of a candidate; scenarios that were shown are not read again.
    fn digest(&mut self, index: usize, scenario: &str, number: u32) -> Result<String, ReviewError> {
        if !self.digests.contains_key(&index) {
            self.scenario(index).transpose()?;
        }
        let known = self.digests.get(&index).and_then(|digests| digests.get(&number));
        known.cloned().ok_or_else(|| ReviewError::Decision {
            scenario: scenario.to_owned(),
            field: "`candidate`",
            value: number.to_string(),
            expected: "the number of one of its candidates".to_owned(),
        })
    }

    fn standing(&self, index: usize) -> Result<String, ReviewError> {
        let entry = &self.store.scenarios()[index];
        let opinions = self.journal.opinions(&entry.scenario_id);
        json(&DecisionStatus::new(index, &opinions, &entry.scenario_digest))
    }
}

fn json(value: &impl Serialize) -> Result<String, ReviewError> {
    serde_json::to_string(value).map_err(|source| ReviewError::Encode { scenario: String::new(), source })
}
