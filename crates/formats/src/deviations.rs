//! Deviated AV trajectories by scenario id, from Parquet or JSON. Described in `docs/files.md`.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::Path;

use reactsim_geometry::Vec2;
use reactsim_scene::{AgentState, Certificate, Deviation, FUTURE, Frame};
use serde::Deserialize;

use super::certificates;
use super::error::{Cause, FormatError};
use super::format::{is_parquet, read_whole};
use super::states::{self, StateColumns};
use super::table::{Batch, Leaf, TableReader, View};

/// Required value of `format` in JSON.
const JSON_FORMAT: &str = "reactsim-deviations-v1";
/// Required value of `reactsim.format` in Parquet files that have this key.
pub const KIND: &str = "reactsim-deviations";
/// Version of the Parquet schema.
pub const VERSION: u32 = 1;
/// Columns that are read in addition to the columns of certificates. `curate` also writes others.
const COLUMNS: [&str; 14] = [
    "scenario_id",
    "category",
    "maneuver",
    "scenario_digest",
    "chosen",
    CURATED,
    "source",
    "origin_x",
    "origin_y",
    "x",
    "y",
    "heading",
    "vx",
    "vy",
];
/// Column that only files of curations have: their trajectories begin with the current frame.
const CURATED: &str = "candidate";
/// Maximum size of a JSON file in bytes.
const MAX_JSON_SIZE: u64 = 1 << 30;

/// One deviated AV trajectory.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviationRecord {
    /// Dominant source of the deviation, if known.
    pub category: Option<Deviation>,
    /// Description of the maneuver in a few words; empty if the file contains none.
    pub maneuver: String,
    /// Name of the file that it was imported from, if the file contains it.
    pub source: Option<String>,
    /// Digest of the scenario that the trajectory was made for, if the file contains it.
    pub scenario_digest: Option<String>,
    /// Origin of the coordinates in the world frame: (0, 0) for world coordinates, `None` for the scenario's
    /// origin.
    pub origin: Option<Vec2>,
    /// State at the current frame, if the file contains it: entry 0 of trajectories of curations, and of
    /// those with 81 entries, one more than the steps of the benchmark.
    pub now: Option<AgentState>,
    /// States at the steps after the current frame, without gaps.
    pub track: Vec<AgentState>,
    /// Responses of the agents that it disturbs, relative to the same origin; present in files of curations.
    pub certificate: Option<Certificate>,
}

impl DeviationRecord {
    /// Returns the states in the frame of a scenario with this origin.
    pub fn track_in(&self, origin: Vec2) -> Vec<AgentState> {
        self.track.iter().map(|s| states::translate(*s, self.origin, origin)).collect()
    }

    /// Returns the state at the current frame in the frame of a scenario with this origin.
    pub fn now_in(&self, origin: Vec2) -> Option<AgentState> {
        self.now.map(|s| states::translate(s, self.origin, origin))
    }

    /// Returns the certificate in the frame of a scenario with this origin.
    pub fn certificate_in(&self, origin: Vec2) -> Option<Certificate> {
        let mut certificate = self.certificate.clone()?;
        let states = certificate.responses.iter_mut().flat_map(|r| &mut r.track);
        states.for_each(|s| *s = states::translate(*s, self.origin, origin));
        Some(certificate)
    }
}

/// Reads the trajectories of a file, one per scenario: the chosen ones if it has a column `chosen` (files of
/// curations), otherwise all.
///
/// # Errors
/// [`FormatError`] names the scenario and the step: gaps, values that are not finite, lists of
/// different lengths, a scenario that occurs twice, an unknown category, missing columns, a file without
/// chosen rows.
pub fn read(path: impl AsRef<Path>) -> Result<BTreeMap<String, DeviationRecord>, FormatError> {
    let mut records = BTreeMap::new();
    let mut take = |scenario: &str, record| match records.insert(scenario.to_owned(), record) {
        None => Ok(()),
        Some(_) => {
            let found = format!("`{scenario}` again");
            Err(Cause::value("scenario_id", found, "one trajectory per scenario"))
        }
    };
    Rows { path: path.as_ref(), wanted: Wanted::Chosen, take: &mut take, next: 0 }.read()?;
    Ok(records)
}

/// Reads all trajectories of a file, chosen or not: any number per scenario, in the order of the file,
/// without certificates.
///
/// # Errors
/// As [`read`], but scenarios may occur often; a file without trajectories is an error.
pub fn read_all(path: impl AsRef<Path>) -> Result<BTreeMap<String, Vec<DeviationRecord>>, FormatError> {
    let path = path.as_ref();
    let mut records: BTreeMap<String, Vec<DeviationRecord>> = BTreeMap::new();
    let mut take = |scenario: &str, record| {
        records.entry(scenario.to_owned()).or_default().push(record);
        Ok(())
    };
    Rows { path, wanted: Wanted::All, take: &mut take, next: 0 }.read()?;
    match records.is_empty() {
        true => Err(FormatError::file(path, Cause::value("the file", "empty", "at least one trajectory"))),
        false => Ok(records),
    }
}

/// The rows that are read.
#[derive(Clone, Copy, PartialEq)]
enum Wanted {
    /// Those that are chosen, with their certificates.
    Chosen,
    /// All, without certificates.
    All,
}

/// The rows of a file on their way to `take`, which refuses a row by the cause that it returns.
struct Rows<'a> {
    path: &'a Path,
    wanted: Wanted,
    take: &'a mut dyn FnMut(&str, DeviationRecord) -> Result<(), Cause>,
    /// Index of the next row.
    next: u64,
}

/// Texts and certificate of a row.
struct Texts<'a> {
    scenario: &'a str,
    category: Option<&'a str>,
    maneuver: Option<&'a str>,
    source: Option<&'a str>,
    scenario_digest: Option<&'a str>,
    certificate: Option<Certificate>,
}

impl Rows<'_> {
    fn read(mut self) -> Result<(), FormatError> {
        if is_parquet(self.path).map_err(|e| FormatError::file(self.path, Cause::read(e)))? {
            self.read_parquet()
        } else {
            self.read_json()
        }
    }

    fn add(
        &mut self,
        texts: Texts<'_>,
        origin: Option<Vec2>,
        now: Result<Frame, Cause>,
        frames: Result<Vec<Frame>, Cause>,
    ) -> Result<(), FormatError> {
        let index = self.next;
        self.next += 1;
        let scenario = texts.scenario;
        let refuse = |cause| FormatError::record(self.path, index, Some(scenario.to_owned()), cause);
        let record = texts.record(origin, now, frames).map_err(refuse)?;
        (self.take)(scenario, record).map_err(refuse)
    }

    fn read_parquet(&mut self) -> Result<(), FormatError> {
        let mut table = TableReader::open(self.path)?;
        table.expect(KIND, VERSION)?;
        match self.wanted {
            Wanted::Chosen => table.only(COLUMNS.into_iter().chain(certificates::read_columns())),
            Wanted::All => table.only(COLUMNS),
        }
        let file = |cause| FormatError::file(self.path, cause);
        let origin = states::table_origin(&table).map_err(file)?;
        let mut skipped = 0;
        while let Some(batch) = table.next_batch() {
            skipped += self.read_batch(&batch?, origin)?;
        }
        if skipped > 0 && skipped == self.next {
            let expected =
                "at least one chosen; loosen the filters of the curation or pick some in its review";
            let cause = Cause::value("`chosen`", format!("false in all {skipped} rows"), expected);
            return Err(FormatError::file(self.path, cause));
        }
        Ok(())
    }

    /// Reads a batch of rows and returns the number of rows that are not wanted.
    fn read_batch(&mut self, batch: &Batch, origin: Option<Vec2>) -> Result<u64, FormatError> {
        let file = |cause| FormatError::file(self.path, cause);
        let ids = View::need(batch, "scenario_id", Leaf::Text, 0).map_err(file)?;
        let text = |name| View::find(batch, name, Leaf::Text, 0).map_err(file);
        let [categories, maneuvers, sources, digests] =
            [text("category")?, text("maneuver")?, text("source")?, text("scenario_digest")?];
        let chosen = match self.wanted {
            Wanted::Chosen => View::find(batch, "chosen", Leaf::Flag, 0).map_err(file)?,
            Wanted::All => None,
        };
        let columns = StateColumns::find(batch, 1).map_err(file)?;
        let x = View::find(batch, "origin_x", Leaf::Number, 0).map_err(file)?;
        let y = View::find(batch, "origin_y", Leaf::Number, 0).map_err(file)?;
        let certificates = certificates::decode(batch).map_err(file)?;
        let is_curated = View::find(batch, CURATED, Leaf::Whole, 0).map_err(file)?.is_some();
        let mut skipped = 0;
        for (row, certificate) in certificates.into_iter().enumerate() {
            if chosen.as_ref().is_some_and(|c| c.flag(row) != Some(true)) {
                (self.next, skipped) = (self.next + 1, skipped + 1);
                continue;
            }
            let (now, frames) = entries(&columns, columns.ranges(|v| v.range(0, row)), is_curated);
            let Some(scenario) = ids.text(row) else {
                let cause = Cause::value("scenario_id", "null", "the id of a scenario");
                return Err(FormatError::record(self.path, self.next, None, cause));
            };
            // The origin of the row takes precedence over the frame in the file's metadata, which other
            // programs lose when they rewrite the file.
            let own = |c: &Option<View>| c.as_ref().and_then(|c| c.number(row));
            let origin = own(&x).zip(own(&y)).map(|(x, y)| Vec2::new(x, y)).or(origin);
            let texts = Texts {
                scenario,
                category: categories.as_ref().and_then(|c| c.text(row)),
                maneuver: maneuvers.as_ref().and_then(|c| c.text(row)),
                source: sources.as_ref().and_then(|c| c.text(row)),
                scenario_digest: digests.as_ref().and_then(|c| c.text(row)),
                certificate,
            };
            self.add(texts, origin, now, frames)?;
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
            let texts = Texts {
                scenario: &one.scenario_id,
                category: one.category.as_deref(),
                maneuver: one.maneuver.as_deref(),
                source: None,
                scenario_digest: one.scenario_digest.as_deref(),
                certificate: None,
            };
            self.add(texts, origin, Ok(None), one.frames())?;
        }
        Ok(())
    }
}

impl Texts<'_> {
    fn record(
        self,
        origin: Option<Vec2>,
        now: Result<Frame, Cause>,
        frames: Result<Vec<Frame>, Cause>,
    ) -> Result<DeviationRecord, Cause> {
        let category = match self.category {
            None | Some("") => None,
            Some(name) => Some(Deviation::from_name(name).ok_or_else(|| {
                Cause::value("category", format!("`{name}`"), "longitudinal, lateral or directional")
            })?),
        };
        let frames = frames?;
        if let Some(gap) = frames.iter().position(Option::is_none) {
            let field = format!("the state at step {}", gap + 1);
            return Err(Cause::value(field, "missing", format!("{} states without gaps", frames.len())));
        }
        let responses = self.certificate.iter().flat_map(|certificate| &certificate.responses);
        if let Some(other) = responses.map(|r| r.track.len()).find(|states| *states != frames.len() + 1) {
            let expected = format!("{}, as many as the AV has", frames.len() + 1);
            return Err(Cause::value("the number of states of a response", other, expected));
        }
        Ok(DeviationRecord {
            category,
            maneuver: self.maneuver.unwrap_or_default().to_owned(),
            source: self.source.map(str::to_owned),
            scenario_digest: self.scenario_digest.filter(|d| !d.is_empty()).map(str::to_owned),
            origin,
            now: now?,
            track: frames.into_iter().flatten().collect(),
            certificate: self.certificate,
        })
    }
}

/// Reads the state at the current frame, if the lists begin with it, and those at the steps after it.
fn entries(
    columns: &StateColumns,
    mut lists: [Option<Range<usize>>; 5],
    is_curated: bool,
) -> (Result<Frame, Cause>, Result<Vec<Frame>, Cause>) {
    let is_one_more = || lists.iter().flatten().all(|list| list.len() == FUTURE + 1);
    let mut now = Ok(None);
    if is_curated && lists.iter().flatten().all(|list| !list.is_empty()) || is_one_more() {
        let first = lists.clone().map(|list| list.map(|list| list.start..list.start + 1));
        now = columns.frames("", &first, 1).map(|frames| frames[0]);
        lists.iter_mut().flatten().for_each(|list| list.start += 1);
    }
    let steps = states::steps(&lists);
    (now, steps.and_then(|steps| columns.frames("", &lists, steps)))
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
struct RawFile {
    format: String,
    frame: Option<String>,
    deviations: Vec<RawTrajectory>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
struct RawTrajectory {
    scenario_id: String,
    category: Option<String>,
    maneuver: Option<String>,
    scenario_digest: Option<String>,
    x: Vec<Option<f64>>,
    y: Vec<Option<f64>>,
    heading: Vec<Option<f64>>,
    vx: Option<Vec<Option<f64>>>,
    vy: Option<Vec<Option<f64>>>,
}

impl RawTrajectory {
    fn frames(&self) -> Result<Vec<Frame>, Cause> {
        let lists = [Some(&self.x), Some(&self.y), Some(&self.heading), self.vx.as_ref(), self.vy.as_ref()];
        let steps = states::check_steps(self.x.len())?;
        for (name, list) in ["x", "y", "heading", "vx", "vy"].iter().zip(lists) {
            if let Some(list) = list.filter(|l| l.len() != steps) {
                return Err(Cause::value(*name, format!("{} steps", list.len()), format!("{steps} steps")));
            }
        }
        let value = |list: Option<&Vec<Option<f64>>>, f: usize| list.and_then(|l| l[f]).unwrap_or(f64::NAN);
        (0..steps).map(|f| states::frame("", f, lists.map(|l| value(l, f)))).collect()
    }
}
