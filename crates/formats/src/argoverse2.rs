//! Argoverse 2 motion forecasting: one Parquet table of tracks per scenario, with a JSON map next to it.
//! Described in `docs/files.md`.

mod lanes;
mod map;
mod parts;
mod point;
mod tracks;

use std::path::{Path, PathBuf};

use reactsim_files::name_of;
use reactsim_scene::{EARLIER_FRAME, LATER_FRAME, Scenario};

use self::tracks::Tracks;
use super::error::{Cause, FormatError};
use super::format::{
    PendingScenarios, ScenarioFormat, UNRECORDED_FRAMES, add_repairs, is_parquet, named, read_whole, single,
};
use super::frames::{CurrentFrames, LengthChoice};
use super::table::TableReader;

/// Index of the latest default current frame among the 110 frames: the last of the 50 frames that forecasters
/// observe.
const CURRENT_FRAME: usize = 49;
/// Maximum size of a map in bytes; usual maps have some hundred kilobytes.
const MAX_MAP_SIZE: u64 = 1 << 26;
/// Part of a map's file name before the id of the scenario.
const MAP_PREFIX: &str = "log_map_archive_";
/// Part of a map's file name after the id of the scenario.
const MAP_SUFFIX: &str = ".json";

pub(super) struct Argoverse2;

impl ScenarioFormat for Argoverse2 {
    fn id(&self) -> &'static str {
        "argoverse2"
    }

    fn title(&self) -> &'static str {
        "Argoverse 2 motion forecasting, Parquet with its map (log_map_archive_*.json) in the same folder"
    }

    fn recognises(&self, path: &Path) -> bool {
        is_parquet(path).unwrap_or(false)
            && TableReader::open(path).is_ok_and(|table| table.has("track_id") && table.has("timestep"))
    }

    fn accompanies(&self, path: &Path) -> bool {
        named(path, MAP_SUFFIX) && name_of(path).starts_with(MAP_PREFIX)
    }

    fn reads_urls(&self) -> bool {
        false
    }

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        single(self, path, frames, move |path, current| read(path, current, length))
    }

    fn count(&self, _path: &Path) -> Option<usize> {
        Some(1)
    }

    fn companions(&self, path: &Path, _length: LengthChoice) -> Vec<PathBuf> {
        let map = Tracks::scenario_id(path).and_then(|id| find_map(path, &id).ok());
        map.into_iter().collect()
    }
}

/// Reads a scenario with the frame `current` (counted from 0, with enough frames before it) as the current
/// one: by default the latest frame up to [`CURRENT_FRAME`] with enough recorded frames of the AV after it.
/// Missing frames after it are counted in the scenario's repairs.
fn read(path: &Path, current: Option<usize>, length: LengthChoice) -> Result<Scenario, FormatError> {
    let before = length.history() - 1;
    if let Some(current) = current.filter(|current| *current < before) {
        let expected = format!("at least {before}, so that there are as many frames before it");
        return Err(FormatError::file(path, Cause::value("the current frame", current, expected)));
    }
    let tracks = Tracks::read(path)?;
    let unknown_types = parts::unknown_types(&tracks);
    let latest = || CURRENT_FRAME.max(before);
    let later = current.map_or_else(|| latest() - CURRENT_FRAME, |_| 0);
    let earlier = current.map_or_else(|| latest() - parts::latest_frame(&tracks, latest(), length), |_| 0);
    let current = current.unwrap_or_else(|| latest() - earlier);
    let id = tracks.scenario_id.clone();
    let refuse = |cause| FormatError::record(path, 0, Some(id.clone()), cause);
    let map_path = find_map(path, &id).map_err(refuse)?;
    let map = map::read(&map_path, &read_whole(&map_path, MAX_MAP_SIZE, "the map of one scenario")?)?;
    let (parts, missing) = parts::parts(tracks, map, current, length).map_err(refuse)?;
    let mut scenario = Scenario::assemble(parts).map_err(|e| {
        let file = if e.field.starts_with("map.") { &map_path } else { path };
        FormatError::scene(file, 0, e)
    })?;
    let counted =
        [(UNRECORDED_FRAMES, missing), (EARLIER_FRAME, earlier as u32), (LATER_FRAME, later as u32)];
    add_repairs(&mut scenario, counted);
    add_repairs(&mut scenario, unknown_types);
    Ok(scenario)
}

/// Finds the map of a scenario: the file in its folder that is named by its id, else the only map there.
fn find_map(path: &Path, id: &str) -> Result<PathBuf, Cause> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let name = format!("{MAP_PREFIX}{id}{MAP_SUFFIX}");
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
            let found = if maps.is_empty() {
                "missing"
            } else {
                "not among several maps in the folder of the scenario"
            };
            let expected = "the map of the scenario in the same folder: download it, or move it there";
            Err(Cause::schema(format!("`{}`", name.escape_debug()), found, expected))
        }
    }
}
