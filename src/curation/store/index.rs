//! A file of which little is kept in memory: what lists and filters need of every candidate, and single scenarios on demand.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};

use super::columns::LIGHT;
use super::decode::Rows;
use super::{open, reader};
use crate::curation::{CurationProvenance, ReviewMark, ScenarioRecord};
use crate::formats::FormatError;
use crate::formats::error::Cause;
use crate::formats::table::TableReader;
use crate::scene::Deviation;

/// A candidate as the index knows it. Fields as in [`crate::curation::CandidateRecord`].
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateEntry {
    /// Number of its random stream.
    pub number: u32,
    /// What the AV does, in a few words.
    pub maneuver: String,
    /// What the source meant to do.
    pub intent: Option<Deviation>,
    /// The category.
    pub category: Deviation,
    /// Id of the first filter that rejected it; `None` for survivors.
    pub rejected_by: Option<String>,
    /// How good it is; NaN for those that did not survive.
    pub score: f64,
    /// Whether it is in the set.
    pub chosen: bool,
    /// Whether there is a certificate.
    pub has_certificate: bool,
    /// Who decided by hand.
    pub review: Option<ReviewMark>,
}

/// A scenario as the index knows it.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioEntry {
    /// Id.
    pub scenario_id: String,
    /// Digest of the scenario.
    pub scenario_digest: String,
    /// The candidates in the order of the file.
    pub candidates: Vec<CandidateEntry>,
    /// Where it lies: row group, and place among the scenarios of that.
    at: (usize, usize),
}

impl ScenarioEntry {
    /// The chosen candidate, where there is one.
    pub fn chosen(&self) -> Option<&CandidateEntry> {
        self.candidates.iter().find(|c| c.chosen)
    }
}

/// The file of a curation, opened for looking at single scenarios. Several threads may share it.
pub struct Store {
    path: PathBuf,
    provenance: CurationProvenance,
    scenarios: Vec<ScenarioEntry>,
    by_id: BTreeMap<String, usize>,
    table: Mutex<TableReader>,
}

impl Store {
    /// Opens a file. All checksums are checked, but tracks, certificates and scenes are not decoded.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be read, is damaged, or no curation wrote it.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let path = path.as_ref();
        let (mut table, provenance) = open(path)?;
        let (mut scenarios, mut by_id) = (Vec::new(), BTreeMap::new());
        for group in 0..table.groups() {
            let batch = table.group(group, LIGHT)?;
            let found = entries(&Rows::new(&batch), group).map_err(|c| FormatError::file(path, c))?;
            for entry in found {
                if by_id.insert(entry.scenario_id.clone(), scenarios.len()).is_some() {
                    return Err(reader::repeated(path, &entry.scenario_id));
                }
                scenarios.push(entry);
            }
        }
        Ok(Self { path: path.to_owned(), provenance, scenarios, by_id, table: Mutex::new(table) })
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the file comes from.
    pub fn provenance(&self) -> &CurationProvenance {
        &self.provenance
    }

    /// All scenarios in file order.
    pub fn scenarios(&self) -> &[ScenarioEntry] {
        &self.scenarios
    }

    /// The place of a scenario among [`Store::scenarios`].
    pub fn find(&self, scenario_id: &str) -> Option<usize> {
        self.by_id.get(scenario_id).copied()
    }

    /// All that the file holds of one scenario. Decodes its row group.
    ///
    /// # Errors
    /// [`FormatError`] when the file can not be read any more or is damaged.
    ///
    /// # Panics
    /// When there are not so many scenarios.
    pub fn scenario(&self, index: usize) -> Result<ScenarioRecord, FormatError> {
        let entry = &self.scenarios[index];
        let (group, place) = entry.at;
        let batch = self.table.lock().unwrap_or_else(PoisonError::into_inner).group(group, &[])?;
        let record = Rows::new(&batch).records().and_then(|records| {
            let found = records.into_iter().nth(place).filter(|r| r.scenario_id == entry.scenario_id);
            found.ok_or_else(|| Cause::Undecodable("rows are not where they were; open it again".into()))
        });
        record.map_err(|cause| FormatError::file(&self.path, cause))
    }
}

fn entries(rows: &Rows<'_>, group: usize) -> Result<Vec<ScenarioEntry>, Cause> {
    let (ids, digests) = (rows.texts("scenario_id")?, rows.texts("scenario_digest")?);
    let (numbers, mut maneuvers) = (rows.wholes("candidate")?, rows.texts("maneuver")?);
    let (intents, categories) = (rows.intents()?, rows.categories()?);
    let (mut rejected, scores) = (rows.maybe_texts("rejected_by")?, rows.scores()?);
    let (chosen, certified) = (rows.flags("chosen")?, rows.flags("has_certificate")?);
    let mut reviews = rows.reviews()?;
    let mut candidate = |row: usize| CandidateEntry {
        number: numbers[row],
        maneuver: std::mem::take(&mut maneuvers[row]),
        intent: intents[row],
        category: categories[row],
        rejected_by: rejected[row].take(),
        score: scores[row],
        chosen: chosen[row],
        has_certificate: certified[row],
        review: reviews[row].take(),
    };
    let scenario = |(place, range): (usize, std::ops::Range<usize>)| ScenarioEntry {
        scenario_id: ids[range.start].clone(),
        scenario_digest: digests[range.start].clone(),
        candidates: range.map(&mut candidate).collect(),
        at: (group, place),
    };
    Ok(rows.scenarios()?.into_iter().enumerate().map(scenario).collect())
}
