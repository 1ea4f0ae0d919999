//! Random access to the scenarios of a file. Memory holds only the candidate data that lists and filters
//! need; scenarios are decoded on demand.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use parking_lot::Mutex;
use reactsim_formats::{FormatError, error::Cause, table::TableReader};
use reactsim_scene::Deviation;

use super::columns::INDEX_COLUMNS;
use super::decode::Rows;
use super::{open, reader};
use crate::{CurationProvenance, ReviewMark, ScenarioRecord};

/// Index entry of a candidate. Fields as in [`crate::CandidateRecord`].
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateEntry {
    /// Number of its random stream.
    pub number: u32,
    /// Short description of the maneuver.
    pub maneuver: String,
    /// Category that the source intended.
    pub intent: Option<Deviation>,
    /// The category.
    pub category: Deviation,
    /// Id of the first filter that rejected it; `None` for survivors.
    pub rejected_by: Option<String>,
    /// Quality; NaN for rejected candidates.
    pub score: f64,
    /// Whether it is in the set.
    pub chosen: bool,
    /// Whether there is a certificate.
    pub has_certificate: bool,
    /// Manual decision, if any.
    pub review: Option<ReviewMark>,
}

/// Index entry of a scenario.
#[derive(Clone, Debug, PartialEq)]
pub struct ScenarioEntry {
    /// Id.
    pub scenario_id: String,
    /// Digest of the scenario.
    pub scenario_digest: String,
    /// The candidates in the order of the file.
    pub candidates: Vec<CandidateEntry>,
    /// Row group, and position among the scenarios in it.
    at: (usize, usize),
}

impl ScenarioEntry {
    /// Returns the chosen candidate, if any.
    pub fn chosen(&self) -> Option<&CandidateEntry> {
        self.candidates.iter().find(|c| c.chosen)
    }
}

/// A curation file opened for access to single scenarios. Several threads may share it.
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
    /// [`FormatError`] when the file cannot be read, is damaged, or was not written by a curation.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, FormatError> {
        let path = path.as_ref();
        let (mut table, provenance) = open(path)?;
        let (mut scenarios, mut by_id) = (Vec::new(), BTreeMap::new());
        for group in 0..table.groups() {
            let batch = table.group(group, INDEX_COLUMNS)?;
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

    /// Returns the path of the file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the provenance of the file.
    pub fn provenance(&self) -> &CurationProvenance {
        &self.provenance
    }

    /// Returns all scenarios in file order.
    pub fn scenarios(&self) -> &[ScenarioEntry] {
        &self.scenarios
    }

    /// Returns the index of a scenario in [`Store::scenarios`].
    pub fn find(&self, scenario_id: &str) -> Option<usize> {
        self.by_id.get(scenario_id).copied()
    }

    /// Reads one scenario. Decodes its row group.
    ///
    /// # Errors
    /// [`FormatError`] when the file has become unreadable or is damaged.
    ///
    /// # Panics
    /// If `index` is out of range.
    pub fn scenario(&self, index: usize) -> Result<ScenarioRecord, FormatError> {
        let entry = &self.scenarios[index];
        let (group, place) = entry.at;
        let batch = self.table.lock().group(group, &[])?;
        let record = Rows::new(&batch).records().and_then(|records| {
            let found = records.into_iter().nth(place).filter(|r| r.scenario_id == entry.scenario_id);
            found.ok_or_else(|| {
                Cause::Undecodable("its rows have moved since it was opened; open it again".into())
            })
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
