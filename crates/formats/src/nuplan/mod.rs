//! nuPlan: logs (`.db`, SQLite) with their maps (`map.gpkg`, GeoPackage), or selections of windows in logs
//! (JSON).
//!
//! A log gives a scenario every ten seconds; a selection lists logs and selects windows by token, tag or
//! time. Maps are read once and shared. Described in `docs/files.md`.

mod layers;
mod library;
mod log;
mod map;
mod parts;
mod selection;
mod sqlite;
mod token;
mod utm;
mod window;
mod wkb;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::vec::IntoIter;

use reactsim_files::as_url;
use reactsim_scene::Scenario;

use self::log::Log;
use self::map::Map;
use self::selection::{Anchors, Selection, WindowChoice};
use self::sqlite::Database;
use self::token::Token;
use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, Scenarios, UndecodedScenario, named};

/// The nuPlan format.
pub(super) struct NuPlan;

impl ScenarioFormat for NuPlan {
    fn id(&self) -> &'static str {
        "nuplan"
    }

    fn title(&self) -> &'static str {
        "nuPlan log, `.db` with its maps, or a selection, JSON with \"format\": \"reactsim-nuplan-v1\""
    }

    fn recognises(&self, path: &Path) -> bool {
        let log = || {
            // A log behind a URL is refused, not opened.
            if as_url(path).is_some() {
                return !self.accompanies(path);
            }
            Database::open(path).is_ok_and(|database| database.has("lidar_pc").unwrap_or(false))
        };
        // By name if the file is too damaged to be recognised by its content.
        named(path, ".db") || selection::is_selection(path) || (sqlite::is_sqlite(path) && log())
    }

    fn accompanies(&self, path: &Path) -> bool {
        named(path, library::MAP_LIST) || named(path, ".gpkg")
    }

    fn reads_urls(&self) -> bool {
        false
    }

    fn open(&self, path: &Path) -> Result<Scenarios, FormatError> {
        Ok(Box::new(Reader::open(path)?.map(|record| record.and_then(|decode| decode()))))
    }

    fn open_undecoded(&self, path: &Path) -> Result<PendingScenarios, FormatError> {
        Ok(Box::new(Reader::open(path)?))
    }

    fn companions(&self, path: &Path) -> Vec<PathBuf> {
        let Ok(Reader { single, logs, maps: folder, .. }) = Reader::open(path) else { return Vec::new() };
        let logs: Vec<PathBuf> = logs.collect();
        let maps: BTreeSet<PathBuf> =
            logs.iter().filter_map(|log| library::map_path(log, folder.as_deref()).ok()).collect();
        let logs = if single { Vec::new() } else { logs };
        logs.into_iter().chain(maps).collect()
    }
}

struct Reader {
    path: PathBuf,
    /// Whether the file is a log, not a selection; errors of a single log end the file.
    single: bool,
    logs: IntoIter<PathBuf>,
    maps: Option<PathBuf>,
    choice: WindowChoice,
    /// Current log with its map and the remaining current frames.
    current: Option<(Arc<Log>, Arc<Map>, IntoIter<usize>)>,
    record: u64,
    /// Tokens not found in any log so far.
    missing: BTreeSet<Token>,
    /// Tags of the logs, if windows are chosen by tags.
    tags: BTreeSet<String>,
    failed: bool,
}

impl Reader {
    fn open(path: &Path) -> Result<Self, FormatError> {
        let single = !selection::is_selection(path);
        let selection = if single {
            Selection { logs: vec![path.to_owned()], maps: None, choice: WindowChoice::default() }
        } else {
            Selection::read(path)?
        };
        let missing = match &selection.choice.anchors {
            Anchors::Tokens(tokens) => tokens.iter().copied().collect(),
            _ => BTreeSet::new(),
        };
        Ok(Self {
            path: path.to_owned(),
            single,
            logs: selection.logs.into_iter(),
            maps: selection.maps,
            choice: selection.choice,
            current: None,
            record: 0,
            missing,
            tags: BTreeSet::new(),
            failed: false,
        })
    }

    /// Reads a log, and its map if a scenario needs it.
    fn load(&mut self, path: &Path) -> Result<(), FormatError> {
        let log = Log::read(path)?;
        let anchors = self.choice.anchors_in(&log);
        if matches!(self.choice.anchors, Anchors::Tagged(_)) {
            self.tags.extend(log.tags.values().flatten().map(|(tag, _)| tag.clone()));
        }
        if anchors.is_empty() {
            return Ok(());
        }
        anchors.iter().for_each(|anchor| {
            self.missing.remove(&log.frames[*anchor].token);
        });
        let folder = match &self.maps {
            Some(folder) => folder.clone(),
            None => library::folder_for(path)?,
        };
        let map = library::map(&folder, &log.map_name)?;
        self.current = Some((Arc::new(log), map, anchors.into_iter()));
        Ok(())
    }

    fn next_decoder(&mut self) -> Option<UndecodedScenario> {
        let (log, map, anchors) = self.current.as_mut()?;
        let Some(anchor) = anchors.next() else {
            self.current = None;
            return None;
        };
        let (log, map, record) = (Arc::clone(log), Arc::clone(map), self.record);
        self.record += 1;
        Some(Box::new(move || read_one(&log, &map, anchor, record)))
    }

    /// Returns the error of a file or selection that gave no scenarios or lacks selected tokens.
    fn final_error(&mut self) -> Option<FormatError> {
        if let Some(token) = self.missing.pop_first() {
            let expected = "the token of a row of `lidar_pc` in one of the logs";
            let cause = Cause::value("tokens", format!("`{token}`"), expected);
            let error = FormatError::record(&self.path, self.record, Some(token.to_string()), cause);
            self.record += 1;
            return Some(error);
        }
        if self.record > 0 || self.failed {
            return None;
        }
        self.failed = true;
        if let Anchors::Tagged(selected) = &self.choice.anchors
            && !selected.iter().any(|tag| self.tags.contains(tag))
        {
            let quoted = |tags: Vec<&str>| format!("`{}`", tags.join("`, `"));
            let expected = if self.tags.is_empty() {
                "another choice: the logs have no tags".to_owned()
            } else {
                format!(
                    "one of those in the logs: {}",
                    quoted(self.tags.iter().map(String::as_str).collect())
                )
            };
            let cause = Cause::value("tags", quoted(selected.iter().map(String::as_str).collect()), expected);
            return Some(FormatError::file(&self.path, cause));
        }
        let expected = "a current frame with 20 rows of the 20 Hz clock before it and 160 after it, either \
                        tagged or in a scene with two scenes before it and two after it";
        Some(FormatError::file(&self.path, Cause::value("the choice of windows", "empty", expected)))
    }
}

impl Iterator for Reader {
    type Item = Result<UndecodedScenario, FormatError>;

    fn next(&mut self) -> Option<Self::Item> {
        loop {
            if let Some(decode) = self.next_decoder() {
                return Some(Ok(decode));
            }
            let Some(path) = self.logs.next() else { return self.final_error().map(Err) };
            if let Err(error) = self.load(&path) {
                self.failed = true;
                let record = self.record;
                self.record += 1;
                let one = |e: FormatError| FormatError::record(&e.path, record, None, *e.cause);
                return Some(Err(if self.single { error } else { one(error) }));
            }
        }
    }
}

fn read_one(log: &Log, map: &Map, anchor: usize, record: u64) -> Result<Scenario, FormatError> {
    let id = log.frames[anchor].token.to_string();
    let parts = parts::parts(log, map, anchor)
        .map_err(|cause| FormatError::record(&log.path, record, Some(id), cause))?;
    Scenario::assemble(parts).map_err(|e| FormatError::scene(&log.path, record, e))
}

#[cfg(test)]
mod tests;
