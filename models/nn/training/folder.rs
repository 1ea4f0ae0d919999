//! The folder of a training: description, log, last checkpoints, weights.

use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

use reactsim_files::{self as files, FolderLock};
use serde_json::{Map, Value};

use super::TrainingError;
use super::checkpoint::{Checkpoint, refuse_other};
use super::log::{Row, read_log};
use super::parameters::Layout;
use super::tensors::{NamedTensors, replace};

/// Name of the file that describes the task, the settings and the data.
pub const ABOUT: &str = "training.json";
/// Name of the log.
pub const LOG: &str = "log.jsonl";
/// Name of the file with the weights of the lowest validation loss; without held-out examples, of the
/// last step.
pub const WEIGHTS: &str = "weights.safetensors";
/// Beginning of the names of networks that are kept on the way.
const KEPT_WEIGHTS: &str = "weights-";
/// Number of checkpoints to keep.
const KEPT_CHECKPOINTS: usize = 2;
/// Field of [`ABOUT`] that identifies the training.
const IDENTITY: &str = "training";

/// The folder of a running training.
pub(super) struct Folder {
    path: PathBuf,
    log: File,
    identity: Value,
    /// Held during the training, so that no other training writes to the folder.
    _lock: FolderLock,
}

impl Folder {
    /// Creates the folder of a new training. Files that are not of a training stay.
    pub(super) fn create(
        path: &Path,
        identity: Value,
        about: &Map<String, Value>,
    ) -> Result<Self, TrainingError> {
        refuse_begun(path)?;
        let lock = lock(path)?;
        refuse_begun(path)?;
        Self::begin(path, lock, identity, about)
    }

    fn begin(
        path: &Path,
        lock: FolderLock,
        identity: Value,
        about: &Map<String, Value>,
    ) -> Result<Self, TrainingError> {
        let mut content = about.clone();
        content.insert(IDENTITY.to_owned(), identity.clone());
        let text = serde_json::to_string_pretty(&content).expect("the description is text and numbers");
        replace(&path.join(ABOUT), format!("{text}\n").as_bytes())?;
        Self::open(path, lock, identity)
    }

    /// Opens the folder of an interrupted training, with its last checkpoint; `None` if it was killed
    /// before the first one. Rows logged after the checkpoint are removed.
    pub(super) fn resume(
        path: &Path,
        identity: Value,
        about: &Map<String, Value>,
        layout: &Layout,
    ) -> Result<(Self, Option<Checkpoint>), TrainingError> {
        // Nothing is changed before the folder is locked: another training may write there.
        let lock = lock(path)?;
        let at = path.join(ABOUT);
        if !at.exists() {
            refuse_begun(path)?;
            return Ok((Self::begin(path, lock, identity, about)?, None));
        }
        let unreadable = |why: String| TrainingError::Unreadable { path: at.clone(), why };
        let text = fs::read(&at).map_err(|e| unreadable(e.to_string()))?;
        let old: Value = serde_json::from_slice(&text).map_err(|e| unreadable(e.to_string()))?;
        refuse_other(path, old.get(IDENTITY).unwrap_or(&Value::Null), &identity)?;
        let checkpoints = checkpoints(path)?;
        let checkpoint = match checkpoints.split_last() {
            None => None,
            Some((last, earlier)) => {
                let read = NamedTensors::read(last).map_err(|e| match e {
                    TrainingError::Unreadable { why, .. } => why,
                    other => other.to_string(),
                });
                let read = read.and_then(|file| Checkpoint::of(file, layout, &identity));
                Some(read.map_err(|why| TrainingError::Checkpoint {
                    path: last.clone(),
                    why,
                    mend: earlier.last().map_or_else(
                        || "delete it to start from the first step".to_owned(),
                        |earlier| format!("delete it to continue from {}", earlier.display()),
                    ),
                })?)
            }
        };
        let log = path.join(LOG);
        if log.exists() {
            // Without a checkpoint even the validation before the first step is repeated.
            let is_done = |row: &Row| checkpoint.as_ref().is_some_and(|c| row.step() <= c.progress.step);
            let kept = read_log(&log)?.into_iter().filter(is_done);
            replace(&log, kept.map(|row| row.line()).collect::<String>().as_bytes())?;
        }
        let folder = Self::open(path, lock, identity)?;
        remove_partial_files(path);
        Ok((folder, checkpoint))
    }

    fn open(path: &Path, lock: FolderLock, identity: Value) -> Result<Self, TrainingError> {
        let at = path.join(LOG);
        let log = OpenOptions::new().create(true).append(true).open(&at);
        let log = log.map_err(|source| TrainingError::Write { path: at, source })?;
        Ok(Self { path: path.to_owned(), log, identity, _lock: lock })
    }

    /// Identity of this training: settings, task and data.
    pub(super) fn identity(&self) -> &Value {
        &self.identity
    }

    /// Appends a row to the log.
    pub(super) fn append(&mut self, row: &Row) -> Result<(), TrainingError> {
        let refuse = |source| TrainingError::Write { path: self.path.join(LOG), source };
        self.log.write_all(row.line().as_bytes()).map_err(refuse)
    }

    /// Writes a checkpoint and removes all but the last ones.
    pub(super) fn keep(
        &mut self,
        checkpoint: &Checkpoint,
        layout: &Layout,
    ) -> Result<PathBuf, TrainingError> {
        self.log.sync_data().map_err(|source| TrainingError::Write { path: self.path.join(LOG), source })?;
        let path = self.path.join(format!("checkpoint-{:08}.safetensors", checkpoint.progress.step));
        checkpoint.tensors(layout, &self.identity).write(&path)?;
        let all = checkpoints(&self.path)?;
        for old in &all[..all.len().saturating_sub(KEPT_CHECKPOINTS)] {
            // A checkpoint that cannot be removed does no harm.
            fs::remove_file(old).ok();
        }
        Ok(path)
    }

    /// Returns the path of the best weights.
    pub(super) fn weights(&self) -> PathBuf {
        self.path.join(WEIGHTS)
    }

    /// Returns the path of the weights that are kept of a step.
    pub(super) fn weights_of(&self, step: u64) -> PathBuf {
        self.path.join(format!("{KEPT_WEIGHTS}{step:08}.safetensors"))
    }

    /// Writes weights as named tensors.
    pub(super) fn put_weights(&self, path: &Path, mut weights: NamedTensors) -> Result<(), TrainingError> {
        weights.about.insert("kind".to_owned(), "reactsim-weights-1".into());
        weights.about.insert("training".to_owned(), self.identity.clone());
        weights.write(path)
    }
}

/// Refuses a folder that contains a training, or a part of one.
fn refuse_begun(path: &Path) -> Result<(), TrainingError> {
    let begun = [ABOUT, LOG, WEIGHTS].iter().any(|name| path.join(name).exists());
    if begun || (path.is_dir() && !checkpoints(path)?.is_empty()) {
        return Err(TrainingError::Exists { path: path.to_owned() });
    }
    Ok(())
}

/// Creates a folder, if it is absent, and locks it.
fn lock(path: &Path) -> Result<FolderLock, TrainingError> {
    let refuse = |path: PathBuf| move |source| TrainingError::Write { path, source };
    files::create_folder(path).map_err(refuse(path.to_owned()))?;
    let lock = files::lock_folder(path).map_err(refuse(path.join(files::LOCK)))?;
    lock.ok_or_else(|| TrainingError::Busy { path: path.to_owned() })
}

/// Removes partially written files of a killed training. Files that cannot be removed only take space.
fn remove_partial_files(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let is_ours = |target: &str| {
            ["checkpoint-", KEPT_WEIGHTS, WEIGHTS, LOG, ABOUT].iter().any(|o| target.starts_with(o))
        };
        if files::target_of(&name).is_some_and(is_ours) {
            fs::remove_file(entry.path()).ok();
        }
    }
}

/// Returns the networks that a training in this folder has kept every few steps, with their steps in order.
///
/// # Errors
/// [`TrainingError::Unreadable`] if the folder cannot be listed.
pub fn kept_weights(folder: &Path) -> Result<Vec<(u64, PathBuf)>, TrainingError> {
    by_step(folder, KEPT_WEIGHTS)
}

/// Returns the checkpoints of a folder in the order of their steps.
fn checkpoints(folder: &Path) -> Result<Vec<PathBuf>, TrainingError> {
    Ok(by_step(folder, "checkpoint-")?.into_iter().map(|(_, path)| path).collect())
}

/// Returns the files of a folder whose names are this beginning and a step, in the order of their steps.
fn by_step(folder: &Path, beginning: &str) -> Result<Vec<(u64, PathBuf)>, TrainingError> {
    let refuse =
        |e: std::io::Error| TrainingError::Unreadable { path: folder.to_owned(), why: e.to_string() };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(refuse)? {
        let path = entry.map_err(refuse)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let step = name.strip_prefix(beginning).and_then(|n| n.strip_suffix(".safetensors"));
        if let Some(step) = step.and_then(|n| n.parse::<u64>().ok()) {
            found.push((step, path));
        }
    }
    found.sort();
    Ok(found)
}
