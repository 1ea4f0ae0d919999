//! Locations of maps, and a cache of the maps read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::SystemTime;

use parking_lot::Mutex;
use serde::Deserialize;

use super::layers;
use super::map::Map;
use super::sqlite::Database;
use crate::error::{Cause, FormatError};
use crate::format::read_whole;

/// Name of the file that lists the maps and their versions.
pub(super) const MAP_LIST: &str = "nuplan-maps-v1.0.json";
/// Number of maps in the cache; nuPlan has four.
const CACHE_SIZE: usize = 4;

#[derive(Deserialize)]
#[serde(expecting = "an object")]
struct Entry {
    version: String,
}

/// Finds the folder with the list of maps of a log: the first one with a list among the folders above the log
/// and their subfolders `maps`.
///
/// # Errors
/// [`FormatError`] states where the list was searched for.
pub(super) fn folder_for(log: &Path) -> Result<PathBuf, FormatError> {
    let whole = std::path::absolute(log).map_err(|e| FormatError::file(log, Cause::read(e)))?;
    let above = whole.ancestors().skip(1);
    let mut places = above.flat_map(|folder| [folder.to_owned(), folder.join("maps")]);
    places.find(|folder| folder.join(MAP_LIST).is_file()).ok_or_else(|| {
        let expected = format!(
            "`{MAP_LIST}` in a folder above the log or in its subfolder `maps`; or give the folder in a \
             selection (docs/files.md)"
        );
        FormatError::file(log, Cause::schema("the folder of the maps", "missing", expected))
    })
}

/// Reads the name of the map of a log.
pub(super) fn name_in(log: &Database) -> Result<String, Cause> {
    let mut only = None;
    log.each("log", &["token", "map_version"], |row| {
        let name = row.text(1)?;
        let name = name.strip_suffix(".gpkg").unwrap_or(&name).to_owned();
        if name.is_empty() || only.as_ref().is_some_and(|other| *other != name) {
            return Err(row.wrong(1, "the name of one map"));
        }
        only = Some(name);
        Ok(())
    })?;
    only.ok_or_else(|| Cause::schema("table `log`", "empty", "one row with the name of the map"))
}

/// Returns the path of the map of a log, in the given folder of maps or that found by [`folder_for`].
pub(super) fn map_path(log: &Path, folder: Option<&Path>) -> Result<PathBuf, FormatError> {
    let folder = folder.map_or_else(|| folder_for(log), |folder| Ok(folder.to_owned()))?;
    let name = name_in(&Database::open(log)?).map_err(|cause| FormatError::file(log, cause))?;
    path_of(&folder, &name)
}

/// Returns a map by name, from the cache if possible.
pub(super) fn map(folder: &Path, name: &str) -> Result<Arc<Map>, FormatError> {
    let path = path_of(folder, name)?;
    let about = std::fs::metadata(&path).map_err(|e| FormatError::file(&path, Cause::read(e)))?;
    let key = Key { path: path.clone(), length: about.len(), changed: about.modified().ok() };
    // Other threads that need the map wait here while it is read.
    let mut cache = CACHE.lock();
    if let Some(at) = cache.iter().position(|(k, _)| *k == key) {
        let found = cache.remove(at);
        let map = Arc::clone(&found.1);
        cache.push(found);
        return Ok(map);
    }
    let map = Arc::new(layers::read(&path)?);
    if cache.len() >= CACHE_SIZE {
        cache.remove(0);
    }
    cache.push((key, Arc::clone(&map)));
    Ok(map)
}

/// Path, size and modification time of a map file.
#[derive(PartialEq)]
struct Key {
    path: PathBuf,
    length: u64,
    changed: Option<SystemTime>,
}

/// Cache of maps, least recently used first.
static CACHE: Mutex<Vec<(Key, Arc<Map>)>> = Mutex::new(Vec::new());

/// Returns the path of a map from the list of maps.
fn path_of(folder: &Path, name: &str) -> Result<PathBuf, FormatError> {
    let list = folder.join(MAP_LIST);
    let refuse = |cause| FormatError::file(&list, cause);
    let content = read_whole(&list, 1 << 20, "the list of maps")?;
    let entries: BTreeMap<String, Entry> =
        serde_json::from_slice(&content).map_err(|e| refuse(Cause::Undecodable(e.to_string())))?;
    let known: Vec<&str> = entries.keys().map(String::as_str).collect();
    let entry = entries.get(name).ok_or_else(|| {
        refuse(Cause::value(
            "`log.map_version` of the log",
            format!("`{name}`"),
            format!("one of {}", known.join(", ")),
        ))
    })?;
    // Both become folder names.
    for part in [name, &entry.version] {
        if part.is_empty() || part.contains(['/', '\\', ':']) || part == ".." || part == "." {
            return Err(refuse(Cause::value(
                "a map or version",
                format!("`{part}`"),
                "the name of a folder",
            )));
        }
    }
    Ok(folder.join(name).join(&entry.version).join("map.gpkg"))
}
