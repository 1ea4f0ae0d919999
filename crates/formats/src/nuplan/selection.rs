//! Selection of the windows of logs that become scenarios.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::filter::{Absent, choose};
use super::library::MAP_LIST;
use super::log::Log;
use super::token::Token;
use super::window;
use crate::error::{Cause, FormatError};
use crate::format::{json_head, named, read_whole};
use crate::frames::{FutureChoice, LengthChoice, seconds};

/// Required value of `format`.
pub(super) const FORMAT: &str = "reactsim-nuplan-v1";
/// Start of `format` in selections of any version.
const FORMAT_PREFIX: &str = "\"reactsim-nuplan-";
/// Default interval in seconds between windows of at most this length, which then do not overlap.
const DEFAULT_INTERVAL: f64 = 10.0;
/// Maximum size of a selection in bytes: a million tokens.
const MAX_SELECTION_SIZE: u64 = 32 << 20;

#[derive(Deserialize)]
#[serde(deny_unknown_fields, expecting = "an object")]
struct RawSelection {
    format: String,
    logs: Vec<PathBuf>,
    maps: Option<PathBuf>,
    filter: Option<PathBuf>,
    tokens: Option<Vec<String>>,
    tags: Option<Vec<String>>,
    every_seconds: Option<f64>,
}

/// Choice of the current frames of scenarios.
#[derive(Clone, Debug)]
pub(super) struct WindowChoice {
    /// Candidate frames.
    pub(super) anchors: Anchors,
    /// Minimum time in seconds between successive current frames.
    pub(super) interval: f64,
    /// Number of frames around them.
    pub(super) length: LengthChoice,
}

/// Candidates for current frames.
#[derive(Clone, Debug)]
pub(super) enum Anchors {
    /// Frames that the devkit offers as scenario starts.
    Starts,
    /// Frames with one of these tags.
    Tagged(Vec<String>),
    /// Frames with these tokens.
    Tokens(Vec<Token>),
}

impl WindowChoice {
    /// Frames that the devkit offers as scenario starts, so far apart that windows do not overlap: only the
    /// first one if scenarios last to the end of the log.
    pub(super) fn regular(length: LengthChoice) -> Self {
        Self { anchors: Anchors::Starts, interval: regular_interval(length), length }
    }

    /// Returns the current frames of a log, in order of time. Frames without enough frames before and after
    /// are left out, except frames selected by token.
    pub(super) fn anchors_in(&self, log: &Log) -> Vec<usize> {
        let all: Vec<usize> = match &self.anchors {
            Anchors::Starts => log.starts(),
            Anchors::Tagged(types) => {
                let tagged = |tags: &[(String, _)]| tags.iter().any(|(tag, _)| types.contains(tag));
                log.tags.iter().filter(|(_, tags)| tagged(tags)).map(|(frame, _)| *frame).collect()
            }
            Anchors::Tokens(tokens) => {
                let frames = log.frames.iter().enumerate();
                return frames
                    .filter(|(_, f)| tokens.binary_search(&f.token).is_ok())
                    .map(|(i, _)| i)
                    .collect();
            }
        };
        let mut last = None;
        let mut is_due = |frame: &usize| {
            let now = log.frames[*frame].timestamp;
            // Half a frame of slack: the clock is only nominally regular.
            let due = last
                .is_none_or(|last: i64| now.saturating_sub(last) as f64 >= self.interval * 1e6 - 25_000.0);
            if due {
                last = Some(now);
            }
            due
        };
        all.into_iter()
            .filter(|frame| window::fits(log.frames.len(), *frame, self.length))
            .filter(|frame| is_due(frame))
            .collect()
    }
}

pub(super) struct Selection {
    pub(super) logs: Vec<PathBuf>,
    /// Folder with the list of maps.
    pub(super) maps: Option<PathBuf>,
    pub(super) choice: WindowChoice,
    /// The scenario filter that chose the windows.
    pub(super) filter: Option<PathBuf>,
    /// Keys of the filter with what is not among the logs.
    pub(super) absent: Vec<Absent>,
}

pub(super) fn is_selection(path: &Path) -> bool {
    json_head(path).is_some_and(|head| head.contains(FORMAT_PREFIX))
}

impl Selection {
    /// Reads a selection; paths in it are relative to its folder.
    pub(super) fn read(path: &Path, length: LengthChoice) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let content = read_whole(path, MAX_SELECTION_SIZE, "a selection of at most 32 MiB")?;
        let raw: RawSelection =
            serde_json::from_slice(&content).map_err(|e| refuse(Cause::Undecodable(e.to_string())))?;
        if raw.format != FORMAT {
            return Err(refuse(Cause::value("format", format!("`{}`", raw.format), format!("`{FORMAT}`"))));
        }
        let folder = path.parent().unwrap_or(Path::new(""));
        let mut logs = Vec::new();
        for log in &raw.logs {
            logs.extend(logs_at(&folder.join(log)).map_err(|cause| {
                let found = format!("`{}` ({cause})", log.display());
                refuse(Cause::value(
                    "logs",
                    found,
                    "`.db` files, or folders that hold some, relative to this file",
                ))
            })?);
        }
        let mut named = BTreeSet::new();
        logs.retain(|log: &PathBuf| named.insert(log.clone()));
        if let Some(maps) = &raw.maps {
            let expected = format!("a folder with `{MAP_LIST}`, relative to this file");
            check_maps(&folder.join(maps))
                .map_err(|_| refuse(Cause::value("maps", format!("`{}`", maps.display()), expected)))?;
        }
        if raw.tokens.as_ref().is_some_and(Vec::is_empty) || raw.tags.as_ref().is_some_and(Vec::is_empty) {
            let key = if raw.tags.is_some() { "tags" } else { "tokens" };
            return Err(refuse(Cause::value(
                key,
                "empty",
                "at least one entry; leave out the key for a window every ten seconds",
            )));
        }
        if logs.is_empty() {
            return Err(refuse(Cause::value(
                "logs",
                "without any log",
                "`.db` files or folders that hold some",
            )));
        }
        let maps = raw.maps.map(|maps| folder.join(maps));
        if let Some(filter) = raw.filter {
            let others = [
                ("tokens", raw.tokens.is_some()),
                ("tags", raw.tags.is_some()),
                ("every_seconds", raw.every_seconds.is_some()),
            ];
            if let Some((key, _)) = others.iter().find(|(_, is_given)| *is_given) {
                return Err(refuse(Cause::value(*key, "given together with `filter`", "one of the two")));
            }
            return Self::filtered(&folder.join(filter), &logs, maps, length);
        }
        let anchors = match (raw.tokens, raw.tags) {
            (Some(_), Some(_)) => {
                return Err(refuse(Cause::value("tokens", "given together with `tags`", "one of the two")));
            }
            (Some(tokens), None) => {
                if raw.every_seconds.is_some() {
                    let found = "given together with `tokens`";
                    return Err(refuse(Cause::value("every_seconds", found, "one of the two")));
                }
                let parse = |text: &String| {
                    let expected = "16 hexadecimal digits, the token of a row of `lidar_pc`";
                    Token::parse(text)
                        .ok_or_else(|| refuse(Cause::value("tokens", format!("`{text}`"), expected)))
                };
                let mut tokens = tokens.iter().map(parse).collect::<Result<Vec<_>, _>>()?;
                tokens.sort();
                tokens.dedup();
                Anchors::Tokens(tokens)
            }
            (None, Some(tags)) => Anchors::Tagged(tags),
            (None, None) => Anchors::Starts,
        };
        let default = if matches!(anchors, Anchors::Starts) { regular_interval(length) } else { 0.0 };
        let interval = raw.every_seconds.unwrap_or(default);
        if raw.every_seconds.is_some() && !(0.0..1e9).contains(&interval) {
            return Err(refuse(Cause::value("every_seconds", interval, "seconds, 0 or more")));
        }
        Ok(Self {
            logs,
            maps,
            choice: WindowChoice { anchors, interval, length },
            filter: None,
            absent: Vec::new(),
        })
    }

    /// Selects the frames of logs that a scenario filter of nuPlan's devkit chooses.
    pub(super) fn filtered(
        filter: &Path,
        logs: &[PathBuf],
        maps: Option<PathBuf>,
        length: LengthChoice,
    ) -> Result<Self, FormatError> {
        let chosen = choose(filter, logs, length)?;
        let choice = WindowChoice { anchors: Anchors::Tokens(chosen.tokens.clone()), interval: 0.0, length };
        let (logs, absent) = (chosen.logs.clone(), chosen.absent.clone());
        Ok(Self { logs, maps, choice, filter: Some(filter.to_owned()), absent })
    }
}

/// Returns the seconds between windows that do not overlap.
fn regular_interval(length: LengthChoice) -> f64 {
    match length.future {
        Some(FutureChoice::Log) => f64::INFINITY,
        _ => seconds(length.history() + length.least_future()).ceil().max(DEFAULT_INTERVAL),
    }
}

/// Checks that a folder has the list of maps.
///
/// # Errors
/// [`FormatError`] if it has none.
pub fn check_maps(folder: &Path) -> Result<(), FormatError> {
    if folder.join(MAP_LIST).is_file() {
        return Ok(());
    }
    Err(FormatError::file(folder, Cause::value("the folder of maps", "without the list of maps", MAP_LIST)))
}

/// Lists the log at a path, or those in a folder in order of their names.
pub(super) fn logs_at(path: &Path) -> Result<Vec<PathBuf>, Cause> {
    let refuse = Cause::read;
    if !std::fs::metadata(path).map_err(refuse)?.is_dir() {
        return Ok(vec![path.to_owned()]);
    }
    let mut logs = Vec::new();
    for entry in std::fs::read_dir(path).map_err(refuse)? {
        let file = entry.map_err(refuse)?.path();
        if named(&file, ".db") && file.is_file() {
            logs.push(file);
        }
    }
    logs.sort();
    Ok(logs)
}
