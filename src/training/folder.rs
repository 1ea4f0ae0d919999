//! The folder of a training: what it is, its log, its last checkpoints, its weights.

use std::fs::{self, File, OpenOptions, TryLockError};
use std::io::Write;
use std::path::{Path, PathBuf};

use serde_json::{Map, Value};

use super::TrainingError;
use super::checkpoint::{Checkpoint, refuse_other};
use super::log::{Row, read_log};
use super::parameters::Layout;
use super::tensors::{NamedTensors, PARTIAL, replace};

/// Name of the file that tells what is trained, how and on what.
pub const ABOUT: &str = "training.json";
/// Name of the log.
pub const LOG: &str = "log.jsonl";
/// Name of the file with the weights of the lowest validation loss; of the last step where nothing is held out.
pub const WEIGHTS: &str = "weights.safetensors";
/// Checkpoints that are kept.
const KEPT: usize = 2;
/// Field of the file that tells what is trained by which a training is told from others.
const IDENTITY: &str = "training";

/// The folder of a training that is going on.
pub(super) struct Folder {
    path: PathBuf,
    log: File,
    identity: Value,
    /// Held while the training lasts: two must not write to one folder.
    _lock: File,
}

impl Folder {
    /// Makes a folder for a new training. What else lies in it stays.
    pub(super) fn create(
        path: &Path,
        identity: Value,
        about: &Map<String, Value>,
    ) -> Result<Self, TrainingError> {
        fs::create_dir_all(path).map_err(|source| TrainingError::Write { path: path.to_owned(), source })?;
        let begun = [ABOUT, LOG].iter().any(|name| path.join(name).exists());
        if begun || !checkpoints(path)?.is_empty() {
            return Err(TrainingError::Exists { path: path.to_owned() });
        }
        let mut content = about.clone();
        content.insert(IDENTITY.to_owned(), identity.clone());
        let text = serde_json::to_string_pretty(&content).expect("it is text and numbers");
        replace(&path.join(ABOUT), format!("{text}\n").as_bytes())?;
        Self::open(path, identity)
    }

    /// Opens the folder of an earlier training that is the same, with its last checkpoint: none where it was killed before the first. What was
    /// logged after the checkpoint is forgotten.
    pub(super) fn resume(
        path: &Path,
        identity: Value,
        about: &Map<String, Value>,
        layout: &Layout,
    ) -> Result<(Self, Option<Checkpoint>), TrainingError> {
        let at = path.join(ABOUT);
        if !at.exists() {
            return Ok((Self::create(path, identity, about)?, None));
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
                        || "delete it to begin again from the first step".to_owned(),
                        |earlier| format!("delete it to go on from {}", earlier.display()),
                    ),
                })?)
            }
        };
        let step = checkpoint.as_ref().map_or(0, |c| c.progress.step);
        let log = path.join(LOG);
        if log.exists() {
            let kept = read_log(&log)?.into_iter().filter(|row| row.step() <= step);
            replace(&log, kept.map(|row| row.line()).collect::<String>().as_bytes())?;
        }
        let folder = Self::open(path, identity)?;
        remove_halves(path);
        Ok((folder, checkpoint))
    }

    fn open(path: &Path, identity: Value) -> Result<Self, TrainingError> {
        let at = path.join(ABOUT);
        let refuse = |path: PathBuf| move |source| TrainingError::Write { path, source };
        let lock = File::open(&at).map_err(refuse(at))?;
        // Where the file system knows no locks there is nothing to be done about it.
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(TrainingError::Busy { path: path.to_owned() });
        }
        let at = path.join(LOG);
        let log = OpenOptions::new().create(true).append(true).open(&at).map_err(refuse(at))?;
        Ok(Self { path: path.to_owned(), log, identity, _lock: lock })
    }

    /// What this training is told from others by.
    pub(super) fn identity(&self) -> &Value {
        &self.identity
    }

    /// Appends a line to the log.
    pub(super) fn append(&mut self, row: &Row) -> Result<(), TrainingError> {
        let refuse = |source| TrainingError::Write { path: self.path.join(LOG), source };
        self.log.write_all(row.line().as_bytes()).map_err(refuse)
    }

    /// Writes a checkpoint and forgets those before the last ones.
    pub(super) fn keep(
        &mut self,
        checkpoint: &Checkpoint,
        layout: &Layout,
    ) -> Result<PathBuf, TrainingError> {
        self.log.sync_data().map_err(|source| TrainingError::Write { path: self.path.join(LOG), source })?;
        let path = self.path.join(format!("checkpoint-{:08}.safetensors", checkpoint.progress.step));
        checkpoint.tensors(layout, &self.identity).write(&path)?;
        let all = checkpoints(&self.path)?;
        for old in &all[..all.len().saturating_sub(KEPT)] {
            // One too many does no harm.
            fs::remove_file(old).ok();
        }
        Ok(path)
    }

    /// Writes weights.
    pub(super) fn put_weights(&self, mut weights: NamedTensors) -> Result<(), TrainingError> {
        weights.about.insert("kind".to_owned(), "reactsim-weights-1".into());
        weights.about.insert("training".to_owned(), self.identity.clone());
        weights.write(&self.path.join(WEIGHTS))
    }

    /// Writes weights in a layout of the task's own.
    pub(super) fn put_file(&self, bytes: &[u8]) -> Result<(), TrainingError> {
        replace(&self.path.join(WEIGHTS), bytes)
    }
}

/// Removes what a kill left of a file that was being written. What can not be removed only takes room.
fn remove_halves(folder: &Path) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let own = ["checkpoint-", WEIGHTS, LOG, ABOUT].iter().any(|own| name.starts_with(own));
        if own && name.ends_with(PARTIAL) {
            fs::remove_file(entry.path()).ok();
        }
    }
}

/// The checkpoints of a folder, by step.
fn checkpoints(folder: &Path) -> Result<Vec<PathBuf>, TrainingError> {
    let refuse =
        |e: std::io::Error| TrainingError::Unreadable { path: folder.to_owned(), why: e.to_string() };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(refuse)? {
        let path = entry.map_err(refuse)?.path();
        let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        let step = name.strip_prefix("checkpoint-").and_then(|n| n.strip_suffix(".safetensors"));
        if let Some(step) = step.and_then(|n| n.parse::<u64>().ok()) {
            found.push((step, path));
        }
    }
    found.sort();
    Ok(found.into_iter().map(|(_, path)| path).collect())
}
