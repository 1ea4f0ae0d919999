//! What is reviewed.

use crate::curation::ScenarioRecord;
use crate::scene::Deviation;

/// Why a scenario can not be had.
pub type DataError = Box<dyn std::error::Error + Send + Sync>;

/// Scenarios with their candidates, in a fixed order. A file of candidates is one.
pub trait ReviewData: Send {
    /// Number of scenarios.
    fn len(&self) -> usize;

    /// Whether there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// What lists and filters need of a scenario, by its number. Must be quick.
    fn entry(&self, index: usize) -> Entry;

    /// A whole scenario.
    ///
    /// # Errors
    /// When it can not be read.
    fn scenario(&self, index: usize) -> Result<ScenarioRecord, DataError>;
}

/// A scenario in a list.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// Id.
    pub scenario_id: String,
    /// Digest of the scenario.
    pub scenario_digest: String,
    /// Its candidates.
    pub candidates: Vec<CandidateEntry>,
}

/// A candidate in a list.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateEntry {
    /// Number of its stream.
    pub number: u32,
    /// Its category.
    pub category: Deviation,
    /// Id of the first filter that rejected it; `None` for survivors.
    pub rejected_by: Option<String>,
    /// Whether it was chosen automatically.
    pub chosen: bool,
}

impl Entry {
    /// The entry of a whole scenario.
    pub fn of(record: &ScenarioRecord) -> Self {
        let candidates = record.candidates.iter().map(|c| CandidateEntry {
            number: c.candidate.number,
            category: c.taxonomy.category,
            rejected_by: c.rejected_by.clone(),
            chosen: c.chosen,
        });
        Self {
            scenario_id: record.scenario_id.clone(),
            scenario_digest: record.scenario_digest.clone(),
            candidates: candidates.collect(),
        }
    }
}

/// Scenarios in memory.
impl ReviewData for Vec<ScenarioRecord> {
    fn len(&self) -> usize {
        Vec::len(self)
    }

    fn entry(&self, index: usize) -> Entry {
        Entry::of(&self[index])
    }

    fn scenario(&self, index: usize) -> Result<ScenarioRecord, DataError> {
        Ok(self[index].clone())
    }
}
