//! Deviated AV trajectories by scenario id, from Parquet or JSON. Described in `scenarios/README.md`.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::ops::Range;
use std::path::Path;

use arrow_array::RecordBatch;
use serde::Deserialize;

use super::certificates::{self, READ_COLUMNS};
use super::error::{Cause, FormatError};
use super::format::{is_parquet, read_whole};
use super::states::{self, StateColumns};
use super::table::{Leaf, TableReader, View};
use crate::geometry::Vec2;
use crate::scene::{AgentState, Certificate, Deviation, FUTURE, Frame};

/// Required value of `format` in JSON.
const JSON_FORMAT: &str = "reactsim-deviations-v1";
/// Required value of `reactsim.format` in Parquet files that have this key.
pub(crate) const KIND: &str = "reactsim-deviations";
/// Version of the Parquet schema.
pub(crate) const VERSION: u32 = 1;
/// Columns that are read; files of curations have many more.
const COLUMNS: &[&str] = &[
    "scenario_id",
    "category",
    "scenario_digest",
    "chosen",
    "origin_x",
    "origin_y",
    "x",
    "y",
    "heading",
    "vx",
    "vy",
    READ_COLUMNS[0],
    READ_COLUMNS[1],
    READ_COLUMNS[2],
    READ_COLUMNS[3],
    READ_COLUMNS[4],
    READ_COLUMNS[5],
    READ_COLUMNS[6],
    READ_COLUMNS[7],
    READ_COLUMNS[8],
    READ_COLUMNS[9],
    READ_COLUMNS[10],
    READ_COLUMNS[11],
    READ_COLUMNS[12],
    READ_COLUMNS[13],
];
/// Maximum size of a JSON file in bytes.
const MAX_JSON_SIZE: u64 = 1 << 30;

/// One deviated AV trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationRecord {
    /// Dominant source of the deviation, if known.
    pub category: Option<Deviation>,
    /// Digest of the scenario that the trajectory was made for, if the file contains it.
    pub scenario_digest: Option<String>,
    /// Origin of the coordinates in the world frame: (0, 0) for world coordinates, `None` for the scenario's
    /// origin.
    pub origin: Option<Vec2>,
    /// States at steps 1 to 80, without gaps.
    pub track: Vec<AgentState>,
    /// Responses of the agents that it disturbs, relative to the same origin; present in files of curations.
    pub certificate: Option<Certificate>,
}

impl DeviationRecord {
    /// Returns the states in the frame of a scenario with this origin.
    pub fn track_in(&self, origin: Vec2) -> Vec<AgentState> {
        self.track.iter().map(|s| states::translate(*s, self.origin, origin)).collect()
    }

    /// Returns the certificate in the frame of a scenario with this origin.
    pub fn certificate_in(&self, origin: Vec2) -> Option<Certificate> {
        let mut certificate = self.certificate.clone()?;
        let states = certificate.responses.iter_mut().flat_map(|r| &mut r.track);
        states.for_each(|s| *s = states::translate(*s, self.origin, origin));
        Some(certificate)
    }
}

/// Reads all trajectories of a file, or only the chosen ones if it has a column `chosen` (files of
/// curations).
///
/// # Errors
/// [`FormatError`] names the scenario and the step: gaps, values that are not finite, a wrong number of
/// steps, a scenario that occurs twice, an unknown category, missing columns, a file without chosen rows.
pub fn read(path: impl AsRef<Path>) -> Result<BTreeMap<String, DeviationRecord>, FormatError> {
    let path = path.as_ref();
    let mut all = RecordCollector { path, records: BTreeMap::new(), next: 0 };
    if is_parquet(path).map_err(|e| FormatError::file(path, Cause::read(e)))? {
        all.read_parquet()?
    } else {
        all.read_json()?
    }
    Ok(all.records)
}

/// Trajectories read so far.
struct RecordCollector<'a> {
    path: &'a Path,
    records: BTreeMap<String, DeviationRecord>,
    /// Index of the next record.
    next: u64,
}

impl RecordCollector<'_> {
    fn add(
        &mut self,
        scenario: &str,
        category: Option<&str>,
        scenario_digest: Option<&str>,
        origin: Option<Vec2>,
        frames: Result<Vec<Frame>, Cause>,
        certificate: Option<Certificate>,
    ) -> Result<(), FormatError> {
        let record = self.next;
        self.next += 1;
        let refuse = |cause| FormatError::record(self.path, record, Some(scenario.to_owned()), cause);
        let category = match category {
            None | Some("") => None,
            Some(name) => Some(Deviation::from_name(name).ok_or_else(|| {
                refuse(Cause::value("category", format!("`{name}`"), "longitudinal, lateral or directional"))
            })?),
        };
        let frames = frames.map_err(refuse)?;
        if let Some(gap) = frames.iter().position(Option::is_none) {
            let field = format!("the state at step {}", gap + 1);
            return Err(refuse(Cause::value(field, "missing", "80 states without gaps")));
        }
        let track = frames.into_iter().flatten().collect();
        let digest = scenario_digest.filter(|d| !d.is_empty()).map(str::to_owned);
        match self.records.entry(scenario.to_owned()) {
            Entry::Occupied(_) => Err(refuse(Cause::value(
                "scenario_id",
                format!("`{scenario}` again"),
                "one trajectory per scenario",
            ))),
            Entry::Vacant(place) => {
                place.insert(DeviationRecord {
                    category,
                    scenario_digest: digest,
                    origin,
                    track,
                    certificate,
                });
                Ok(())
            }
        }
    }

    fn read_parquet(&mut self) -> Result<(), FormatError> {
        let mut table = TableReader::open(self.path)?;
        table.expect(KIND, VERSION)?;
        table.only(COLUMNS);
        let file = |cause| FormatError::file(self.path, cause);
        let origin = states::table_origin(&table).map_err(file)?;
        let mut skipped = 0;
        while let Some(batch) = table.next_batch() {
            skipped += self.read_batch(&batch?, origin)?;
        }
        if self.records.is_empty() && skipped > 0 {
            let expected =
                "at least one chosen; loosen the filters of the curation or pick some in its review";
            return Err(file(Cause::value("`chosen`", format!("false in all {skipped} rows"), expected)));
        }
        Ok(())
    }

    /// Reads a batch of rows and returns the number of rows that are not chosen.
    fn read_batch(&mut self, batch: &RecordBatch, origin: Option<Vec2>) -> Result<u64, FormatError> {
        let file = |cause| FormatError::file(self.path, cause);
        let ids = View::need(batch, "scenario_id", Leaf::Text, 0).map_err(file)?;
        let categories = View::find(batch, "category", Leaf::Text, 0).map_err(file)?;
        let digests = View::find(batch, "scenario_digest", Leaf::Text, 0).map_err(file)?;
        let chosen = View::find(batch, "chosen", Leaf::Flag, 0).map_err(file)?;
        let columns = StateColumns::find(batch, 1).map_err(file)?;
        let x = View::find(batch, "origin_x", Leaf::Number, 0).map_err(file)?;
        let y = View::find(batch, "origin_y", Leaf::Number, 0).map_err(file)?;
        let certificates = certificates::decode(batch).map_err(file)?;
        let mut skipped = 0;
        for (row, certificate) in certificates.into_iter().enumerate() {
            if chosen.as_ref().is_some_and(|c| c.flag(row) != Some(true)) {
                (self.next, skipped) = (self.next + 1, skipped + 1);
                continue;
            }
            let frames = columns.frames("", &future(columns.ranges(|v| v.range(0, row))), FUTURE);
            let category = categories.as_ref().and_then(|c| c.text(row));
            let digest = digests.as_ref().and_then(|c| c.text(row));
            let Some(id) = ids.text(row) else {
                let cause = Cause::value("scenario_id", "null", "the id of a scenario");
                return Err(FormatError::record(self.path, self.next, None, cause));
            };
            // The origin of the row takes precedence over the frame in the file's metadata, which other
            // programs lose when they rewrite the file.
            let own = |c: &Option<View>| c.as_ref().and_then(|c| c.number(row));
            let origin = own(&x).zip(own(&y)).map(|(x, y)| Vec2::new(x, y)).or(origin);
            self.add(id, category, digest, origin, frames, certificate)?;
        }
        Ok(skipped)
    }

    fn read_json(&mut self) -> Result<(), FormatError> {
        let file = |cause| FormatError::file(self.path, cause);
        let text = read_whole(self.path, MAX_JSON_SIZE, "at most 1 GiB; write larger sets as Parquet")?;
        let raw: RawFile =
            serde_json::from_slice(&text).map_err(|e| file(Cause::Undecodable(e.to_string())))?;
        if raw.format != JSON_FORMAT {
            let found = format!("`{}`", raw.format);
            return Err(file(Cause::schema("`format`", found, format!("`{JSON_FORMAT}`"))));
        }
        let origin = states::origin("`frame`", raw.frame.as_deref()).map_err(file)?;
        for one in raw.deviations {
            let frames = one.frames();
            self.add(
                &one.scenario_id,
                one.category.as_deref(),
                one.scenario_digest.as_deref(),
                origin,
                frames,
                None,
            )?;
        }
        Ok(())
    }
}

/// Removes the state of the current frame (step 0) from lists that begin with it.
fn future(mut lists: [Option<Range<usize>>; 5]) -> [Option<Range<usize>>; 5] {
    if lists.iter().flatten().all(|list| list.len() == FUTURE + 1) {
        lists.iter_mut().flatten().for_each(|list| list.start += 1);
    }
    lists
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[serde(expecting = "an object")]
struct RawFile {
    format: String,
    #[serde(default)]
    frame: Option<String>,
    deviations: Vec<RawTrajectory>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
#[serde(expecting = "an object")]
struct RawTrajectory {
    scenario_id: String,
    #[serde(default)]
    category: Option<String>,
    #[serde(default)]
    scenario_digest: Option<String>,
    x: Vec<Option<f64>>,
    y: Vec<Option<f64>>,
    heading: Vec<Option<f64>>,
    #[serde(default)]
    vx: Option<Vec<Option<f64>>>,
    #[serde(default)]
    vy: Option<Vec<Option<f64>>>,
}

impl RawTrajectory {
    fn frames(&self) -> Result<Vec<Frame>, Cause> {
        let lists = [Some(&self.x), Some(&self.y), Some(&self.heading), self.vx.as_ref(), self.vy.as_ref()];
        for (name, list) in ["x", "y", "heading", "vx", "vy"].iter().zip(lists) {
            if let Some(list) = list.filter(|l| l.len() != FUTURE) {
                return Err(Cause::value(*name, format!("{} steps", list.len()), "80 steps"));
            }
        }
        let value = |list: Option<&Vec<Option<f64>>>, f: usize| list.and_then(|l| l[f]).unwrap_or(f64::NAN);
        (0..FUTURE).map(|f| states::frame("", f, lists.map(|l| value(l, f)))).collect()
    }
}
