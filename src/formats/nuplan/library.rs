//! Where maps lie, and those that were read.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

use serde::Deserialize;

use super::layers;
use super::map::Map;
use super::sqlite::Database;
use crate::formats::error::{Cause, FormatError};
use crate::formats::format::read_whole;

/// The file that names the maps and their versions.
pub(super) const LIST: &str = "nuplan-maps-v1.0.json";
/// How many maps are kept: nuPlan has four.
const KEPT: usize = 4;

#[derive(Deserialize)]
struct Entry {
    version: String,
}

/// The folder with the list of maps that belongs to a log: the first that holds one of the folders above the log and their
/// subfolders `maps`.
///
/// # Errors
/// [`FormatError`] says where one was looked for.
pub(super) fn folder_for(log: &Path) -> Result<PathBuf, FormatError> {
    let whole = std::path::absolute(log).map_err(|e| FormatError::file(log, Cause::read(e)))?;
    let above = whole.ancestors().skip(1);
    let mut places = above.flat_map(|folder| [folder.to_owned(), folder.join("maps")]);
    places.find(|folder| folder.join(LIST).is_file()).ok_or_else(|| {
        let expected = format!(
            "`{LIST}` in a folder above the log, or in `maps` of one; or name the folder in a selection (scenarios/README.md)"
        );
        FormatError::file(log, Cause::schema("the folder of the maps", "missing", expected))
    })
}

/// The name of the map that a log names.
///
/// # Errors
/// [`Cause`] names the table, the column and the row.
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

/// Where the map of a log lies, in this folder of maps or that which belongs to the log.
///
/// # Errors
/// [`FormatError`] when the log, or the list of maps, can not be read or does not name it.
pub(super) fn beside(log: &Path, folder: Option<&Path>) -> Result<PathBuf, FormatError> {
    let folder = folder.map_or_else(|| folder_for(log), |folder| Ok(folder.to_owned()))?;
    let name = name_in(&Database::open(log)?).map_err(|cause| FormatError::file(log, cause))?;
    path_of(&folder, &name)
}

/// The map of a name, read once while it is in use and kept for the next log.
///
/// # Errors
/// [`FormatError`] when the list or the map can not be read.
pub(super) fn map(folder: &Path, name: &str) -> Result<Arc<Map>, FormatError> {
    let path = path_of(folder, name)?;
    let about = std::fs::metadata(&path).map_err(|e| FormatError::file(&path, Cause::read(e)))?;
    let key = Key { path: path.clone(), length: about.len(), changed: about.modified().ok() };
    // Whoever needs the map while it is read waits here.
    let mut kept = KEPT_MAPS.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(at) = kept.iter().position(|(k, _)| *k == key) {
        let found = kept.remove(at);
        let map = Arc::clone(&found.1);
        kept.push(found);
        return Ok(map);
    }
    let map = Arc::new(layers::read(&path)?);
    if kept.len() >= KEPT {
        kept.remove(0);
    }
    kept.push((key, Arc::clone(&map)));
    Ok(map)
}

#[derive(PartialEq)]
struct Key {
    path: PathBuf,
    length: u64,
    changed: Option<SystemTime>,
}

/// The maps that were read, the latest used last.
static KEPT_MAPS: Mutex<Vec<(Key, Arc<Map>)>> = Mutex::new(Vec::new());

fn path_of(folder: &Path, name: &str) -> Result<PathBuf, FormatError> {
    let list = folder.join(LIST);
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
    // Both become names of folders.
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
