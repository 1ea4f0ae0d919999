//! nuPlan: logs (`.db`, SQLite) with their maps (`map.gpkg`, GeoPackage), or selections of windows in logs
//! (JSON).
//!
//! A log gives a scenario every ten seconds; a selection lists logs and selects windows by token, tag, time
//! or a scenario filter of nuPlan's devkit. Maps are read once and shared. Described in `docs/files.md`.

mod drive;
mod filter;
mod index;
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
mod yaml;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::vec::IntoIter;

use reactsim_files::as_url;
use reactsim_scene::Scenario;

pub use self::drive::Pose;
pub(super) use self::drive::{Drive, ROWS_BEFORE, scenes};
use self::filter::Absent;
use self::log::Log;
use self::map::Map;
pub use self::selection::check_maps;
use self::selection::{Anchors, Selection, WindowChoice, logs_at};
use self::sqlite::Database;
pub(super) use self::token::Token;
use super::error::{Cause, FormatError};
use super::format::{PendingScenarios, ScenarioFormat, UndecodedScenario, named, with_stated_frames};
use super::frames::{CurrentFrames, LengthChoice};
use super::list::Input;

pub(super) struct NuPlan {
    /// Logs and folder of maps of a scenario filter, which states neither.
    given: Option<(Vec<PathBuf>, Option<PathBuf>)>,
}

/// The format of logs and selections.
pub(super) const NUPLAN: NuPlan = NuPlan { given: None };

/// Returns the scenarios of logs (files, or folders that hold some) that a scenario filter of nuPlan's devkit
/// chooses. Without a folder of maps, it is searched for above the logs.
///
/// # Errors
/// [`FormatError`] if the logs or the maps are not there. Errors of the filter appear when it is opened.
pub fn nuplan_filter(filter: &Path, logs: &[PathBuf], maps: Option<PathBuf>) -> Result<Input, FormatError> {
    let mut found = Vec::new();
    for path in logs {
        let here = logs_at(path).map_err(|cause| FormatError::file(path, cause))?;
        if here.is_empty() {
            let cause =
                Cause::value("the folder", "without logs", "`.db` files, or a folder that holds some");
            return Err(FormatError::file(path, cause));
        }
        found.extend(here);
    }
    found.sort();
    found.dedup();
    maps.as_deref().map_or(Ok(()), check_maps)?;
    // Formats live as long as the program, which has one for every filter that it is given.
    let format: &'static NuPlan = Box::leak(Box::new(NuPlan { given: Some((found, maps)) }));
    Ok(Input::new(filter.to_owned(), format))
}

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

    fn open_at(
        &self,
        path: &Path,
        frames: CurrentFrames,
        length: LengthChoice,
    ) -> Result<PendingScenarios, FormatError> {
        with_stated_frames(self, path, frames, || Ok(Box::new(self.reader(path, length)?)))
    }

    fn companions(&self, path: &Path, length: LengthChoice) -> Vec<PathBuf> {
        let Ok(Reader { single, logs, maps: folder, filter, .. }) = self.reader(path, length) else {
            return Vec::new();
        };
        let logs: Vec<PathBuf> = logs.collect();
        let maps: BTreeSet<PathBuf> =
            logs.iter().filter_map(|log| library::map_path(log, folder.as_deref()).ok()).collect();
        let logs = if single { Vec::new() } else { logs };
        let filter = filter.filter(|filter| filter != path);
        filter.into_iter().chain(logs).chain(maps).collect()
    }
}

impl NuPlan {
    fn reader(&self, path: &Path, length: LengthChoice) -> Result<Reader, FormatError> {
        match &self.given {
            Some((logs, maps)) => {
                Ok(Reader::of(path, Selection::filtered(path, logs, maps.clone(), length)?))
            }
            None => Reader::open(path, length),
        }
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
    /// The scenario filter that chose the windows, if one did.
    filter: Option<PathBuf>,
    /// Keys of the filter with what is not among the logs; not reported so far.
    absent: IntoIter<Absent>,
}

impl Reader {
    fn open(path: &Path, length: LengthChoice) -> Result<Self, FormatError> {
        if selection::is_selection(path) {
            return Ok(Self::of(path, Selection::read(path, length)?));
        }
        let (choice, maps) = (WindowChoice::regular(length), None);
        let log = Selection { logs: vec![path.to_owned()], maps, choice, filter: None, absent: Vec::new() };
        Ok(Self { single: true, ..Self::of(path, log) })
    }

    fn of(path: &Path, selection: Selection) -> Self {
        let missing = match &selection.choice.anchors {
            Anchors::Tokens(tokens) => tokens.iter().copied().collect(),
            _ => BTreeSet::new(),
        };
        Self {
            path: path.to_owned(),
            single: false,
            logs: selection.logs.into_iter(),
            maps: selection.maps,
            choice: selection.choice,
            current: None,
            record: 0,
            missing,
            tags: BTreeSet::new(),
            failed: false,
            filter: selection.filter,
            absent: selection.absent.into_iter(),
        }
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
        let (log, map, record, length) = (Arc::clone(log), Arc::clone(map), self.record, self.choice.length);
        self.record += 1;
        Some(UndecodedScenario::new(move || read_one(&log, &map, anchor, record, length)))
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
        if let Some((key, found)) = self.absent.next() {
            let cause = Cause::value(key, format!("in part not among the logs: {found}"), "all of them");
            self.record += 1;
            return Some(FormatError::record(&self.path, self.record - 1, None, cause));
        }
        if self.record > 0 || self.failed {
            return None;
        }
        self.failed = true;
        if self.filter.is_some() {
            let expected =
                "keys that some frame of the logs meets, with two scenes before it and two after it";
            return Some(FormatError::file(
                &self.path,
                Cause::value("the filter", "met by no frame", expected),
            ));
        }
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
        let [before, after] = window::needed(self.choice.length);
        let expected = format!(
            "a current frame with {before} rows of the 20 Hz clock before it and {after} after it, either \
             tagged or in a scene with two scenes before it and two after it"
        );
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

fn read_one(
    log: &Log,
    map: &Map,
    anchor: usize,
    record: u64,
    length: LengthChoice,
) -> Result<Scenario, FormatError> {
    let id = log.frames[anchor].token.to_string();
    let parts = parts::parts(log, map, anchor, length)
        .map_err(|cause| FormatError::record(&log.path, record, Some(id), cause))?;
    Scenario::assemble(parts).map_err(|e| FormatError::scene(&log.path, record, e))
}

#[cfg(test)]
mod tests;
