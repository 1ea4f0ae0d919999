//! The frames of logs that file names refer to.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

use reactsim_scene::Deviation;
use serde::{Deserialize, Serialize};

use super::layout::{Sample, Windows};
use crate::error::{Cause, FormatError};
use crate::format::named;
use crate::nuplan::{Drive, ROWS_BEFORE, Token, scenes};

/// What the name of a file refers to.
#[derive(Clone, Debug)]
pub struct BenchName {
    map: String,
    scene: Token,
    sample: Token,
}

impl BenchName {
    /// Parses the name of a file.
    ///
    /// # Errors
    /// The expected form of the name.
    pub fn of(path: &Path) -> Result<Self, String> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let parts = stem.rsplit_once('_').and_then(|(rest, sample)| {
            let (map, scene) = rest.rsplit_once('_')?;
            Some(Self { map: map.to_owned(), scene: Token::parse(scene)?, sample: Token::parse(sample)? })
        });
        parts.ok_or_else(|| {
            "the name is not MAP_SCENE_SAMPLE.pkl with two tokens of 16 hexadecimal digits".to_owned()
        })
    }

    /// Returns the token of the scene as text.
    pub fn scene(&self) -> String {
        self.scene.to_string()
    }
}

/// Tokens of the scenes of a log, valid for a size and a time of change.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct IndexedLog {
    /// The log.
    pub path: PathBuf,
    bytes: u64,
    changed: u64,
    /// Tokens of its scenes.
    pub scenes: Vec<String>,
}

impl IndexedLog {
    /// Reads the scenes of a log.
    ///
    /// # Errors
    /// [`FormatError`] if it is no log.
    pub fn read(path: &Path) -> Result<Self, FormatError> {
        let (bytes, changed) = about(path).map_err(|source| FormatError::file(path, Cause::read(source)))?;
        let scenes = scenes(path)?.iter().map(Token::to_string).collect();
        Ok(Self { path: path.to_owned(), bytes, changed, scenes })
    }

    /// Returns whether the log is the one that was read.
    pub fn is_current(&self) -> bool {
        about(&self.path).is_ok_and(|found| found == (self.bytes, self.changed))
    }
}

/// Returns the size of a file and when it was changed, in nanoseconds.
fn about(path: &Path) -> std::io::Result<(u64, u64)> {
    let about = path.metadata()?;
    let changed = about.modified()?.duration_since(UNIX_EPOCH).unwrap_or_default();
    Ok((about.len(), u64::try_from(changed.as_nanos()).unwrap_or(u64::MAX)))
}

/// Lists files with one of the endings (`.db`, `.pkl`) in folders and those below them, in order of their paths.
///
/// # Errors
/// [`FormatError`] names the folder that cannot be read.
pub fn files_in(paths: &[PathBuf], endings: &[&str]) -> Result<Vec<PathBuf>, FormatError> {
    let mut found = BTreeSet::new();
    let mut waiting: Vec<PathBuf> = paths.to_vec();
    while let Some(path) = waiting.pop() {
        let refuse = |source| FormatError::file(&path, Cause::read(source));
        if !std::fs::metadata(&path).map_err(refuse)?.is_dir() {
            found.insert(path);
            continue;
        }
        for entry in std::fs::read_dir(&path).map_err(refuse)? {
            let inner = entry.map_err(refuse)?.path();
            if inner.is_dir() || endings.iter().any(|ending| named(&inner, ending)) {
                waiting.push(inner);
            }
        }
    }
    Ok(found.into_iter().collect())
}

/// File with the frames of a log that its name refers to.
#[derive(Clone, Debug)]
pub struct Located {
    /// The file.
    pub path: PathBuf,
    /// The log.
    pub log: PathBuf,
    /// Poses of the AV in the scenario, by the meaning of the second token.
    pub windows: Windows,
    /// Tokens of the current frame.
    pub current: [Option<String>; 2],
    /// Why there is no such scenario.
    pub missing: [String; 2],
    /// Whether the frame is in another scene than the name states.
    pub other_scene: bool,
    /// Category that the file states.
    pub category: Option<Deviation>,
}

/// Finds the frames of a log that names refer to; `Ok(Err)` is a name that contradicts the log.
///
/// # Errors
/// [`FormatError`] if the log cannot be read.
pub fn locate(
    log: &Path,
    files: &[&(PathBuf, BenchName)],
) -> Result<Vec<Result<Located, String>>, FormatError> {
    let drive = Drive::read(log)?;
    Ok(files.iter().map(|(path, name)| in_drive(log, &drive, path, name)).collect())
}

fn in_drive(log: &Path, drive: &Drive, path: &Path, name: &BenchName) -> Result<Located, String> {
    let row = drive.row_of(name.sample);
    let row = row.ok_or_else(|| {
        format!("the log of the scene {} has no frame with the token {}", name.scene, name.sample)
    })?;
    if drive.map_name() != name.map {
        return Err(format!("the name states the map {}, the log has {}", name.map, drive.map_name()));
    }
    let mut located = Located {
        path: path.to_owned(),
        log: log.to_owned(),
        windows: [None, None],
        current: [None, None],
        missing: Default::default(),
        other_scene: drive.tokens(row).is_none_or(|(_, scene)| scene != name.scene),
        category: None,
    };
    for sample in Sample::ALL {
        let (at, i) = (row + if sample == Sample::First { ROWS_BEFORE } else { 0 }, sample as usize);
        match drive.window(at) {
            Ok(window) => located.windows[i] = Some(window),
            Err(cause) => located.missing[i] = cause.to_string(),
        }
        located.current[i] = drive.tokens(at).map(|(token, _)| token.to_string());
    }
    Ok(located)
}
