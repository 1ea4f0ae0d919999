//! Argoverse 2 motion forecasting: one Parquet table of tracks per scenario, and a map in JSON beside it. Told in `scenarios/README.md`.

mod lanes;
mod map;
mod parts;
mod tracks;

use std::path::{Path, PathBuf};

use self::tracks::Tracks;
use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, Scenarios, Undecoded, is_parquet, named, read_whole};
use super::table::TableReader;
use crate::scene::{HISTORY, Scenario};

/// What of the 110 frames is the current one, unless another is asked for: the last of the 50 that forecasters are shown.
const CURRENT_FRAME: usize = 49;
/// Longest map that is read: usual ones have some hundred kilobytes.
const LONGEST_MAP: u64 = 1 << 26;
/// How maps are named; the id of the scenario stands between.
const MAP_NAME: (&str, &str) = ("log_map_archive_", ".json");

/// The format.
pub(super) struct Argoverse2;

impl ScenarioFormat for Argoverse2 {
    fn id(&self) -> &'static str {
        "argoverse2"
    }

    fn title(&self) -> &'static str {
        "Argoverse 2 motion forecasting, Parquet with its map (log_map_archive_*.json) beside it"
    }

    fn recognises(&self, path: &Path) -> bool {
        is_parquet(path).unwrap_or(false)
            && TableReader::open(path).is_ok_and(|table| table.has("track_id") && table.has("timestep"))
    }

    fn accompanies(&self, path: &Path) -> bool {
        let (begin, end) = MAP_NAME;
        named(path, end) && path.file_name().is_some_and(|n| n.to_string_lossy().starts_with(begin))
    }

    fn open(&self, path: &Path) -> Result<Scenarios, FormatError> {
        let scenario = self.read_at(path, CURRENT_FRAME)?;
        Ok(Box::new(std::iter::once(Ok(scenario))))
    }

    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        let path: PathBuf = path.to_owned();
        let decode: Undecoded = Box::new(move || Argoverse2.read_at(&path, CURRENT_FRAME));
        Ok(Box::new(std::iter::once(Ok(decode))))
    }

    fn read_at(&self, path: &Path, current_frame: usize) -> Result<Scenario, FormatError> {
        read(path, current_frame)
    }

    fn companions(&self, path: &Path) -> Vec<PathBuf> {
        let map = Tracks::scenario_id(path).and_then(|id| map_beside(path, &id).ok());
        map.into_iter().collect()
    }
}

/// Reads a scenario of which the frame `current` (from 10 on, counted from 0) is the current one. The ten frames before it are the history.
/// What lacks of the 80 frames after it is counted in the scenario's repairs.
fn read(path: &Path, current: usize) -> Result<Scenario, FormatError> {
    if current + 1 < HISTORY {
        let cause = Cause::value("the current frame", current, "at least 10, so that there is a history");
        return Err(FormatError::file(path, cause));
    }
    let tracks = Tracks::read(path)?;
    let id = tracks.scenario_id.clone();
    let refuse = |cause| FormatError::record(path, 0, Some(id.clone()), cause);
    let map_path = map_beside(path, &id).map_err(refuse)?;
    let map = map::read(&map_path, &read_whole(&map_path, LONGEST_MAP, "the map of one scenario")?)?;
    let (parts, lacking) = parts::parts(tracks, map, current).map_err(refuse)?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| {
        let file = if e.field.starts_with("map.") { &map_path } else { path };
        FormatError::scene(file, 0, e)
    })?;
    if lacking > 0 {
        scenario.repairs.insert("frames at the end that are not recorded".into(), lacking);
    }
    Ok(scenario)
}

/// The map of a scenario: the file beside it that is named by its id, else the only map there.
fn map_beside(path: &Path, id: &str) -> Result<PathBuf, Cause> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let name = format!("{}{id}{}", MAP_NAME.0, MAP_NAME.1);
    // An id from a file must not lead out of the folder.
    if id.chars().all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_') {
        let named = folder.join(&name);
        if named.is_file() {
            return Ok(named);
        }
    }
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let mut maps = Vec::new();
    for entry in std::fs::read_dir(here).map_err(Cause::read)? {
        let path = entry.map_err(Cause::read)?.path();
        if Argoverse2.accompanies(&path) {
            maps.push(path);
        }
        if maps.len() > 1 {
            break;
        }
    }
    match <[PathBuf; 1]>::try_from(maps) {
        Ok([only]) => Ok(only),
        Err(maps) => {
            let found =
                if maps.is_empty() { "missing" } else { "not among several maps beside the scenario" };
            let expected =
                "the map that belongs to the scenario in the same folder: fetch it, or move it there";
            Err(Cause::schema(format!("`{}`", name.escape_debug()), found, expected))
        }
    }
}
