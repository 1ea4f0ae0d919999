//! The folder of a study: how it begins, and how it goes on after an interruption.

use std::fs::{self, File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};

use super::file::{STUDY, read};
use super::{Member, Study, StudyPlan};
use crate::evaluation::folder::{
    FAILURES, PROVENANCE, ROLLOUTS, RunFolder, SUMMARY, TABLE, cannot_read, cannot_write, replace,
};
use crate::evaluation::{EvaluationError, Provenance, Summary, read_summary, read_tally};

/// The folder of a study that is being made.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// Held while the study lasts: two programs must not write to one folder.
    _lock: File,
}

impl StudyFolder {
    /// Makes a folder for a new study; it may exist if it is empty.
    ///
    /// # Errors
    /// [`EvaluationError`] when the folder is not empty or can not be written.
    pub fn create(path: &Path, study: &Study) -> Result<Self, EvaluationError> {
        fs::create_dir_all(path).map_err(cannot_write(path))?;
        if !is_unbegun(path) {
            return Err(EvaluationError::Exists { path: path.to_owned() });
        }
        replace(&path.join(STUDY), |out| out.write_all(study.to_json().as_bytes()))?;
        Self::open(path)
    }

    /// Opens the folder of an earlier study with the same members and settings; of those that are not begun nothing is asked.
    ///
    /// # Errors
    /// [`EvaluationError`] when the folder holds no study, a study of something else, or a run with other settings, which are named.
    pub fn resume(path: &Path, plan: &mut StudyPlan) -> Result<Self, EvaluationError> {
        if is_unbegun(path) {
            return Self::create(path, plan.study());
        }
        let old = read(path)?;
        let folder = Self::open(path)?;
        let other = |setting: &str, old: String, new: String| EvaluationError::OtherSettings {
            path: path.to_owned(),
            setting: setting.to_owned(),
            old,
            new,
        };
        let new = plan.study().clone();
        if old.kind != new.kind {
            return Err(other("study", old.kind.name().to_owned(), new.kind.name().to_owned()));
        }
        for (i, member) in new.members.iter().enumerate() {
            let provenance = plan.select(i).provenance();
            RunFolder::is_of(&folder.member(member), &provenance)?;
        }
        if old != new {
            let names =
                |of: &Study| of.members.iter().map(|m| m.folder.as_str()).collect::<Vec<_>>().join(", ");
            if names(&old) != names(&new) {
                return Err(other("members", names(&old), names(&new)));
            }
            let ids =
                |of: &Study| of.members.iter().flat_map(|m| m.originals.keys().cloned()).collect::<Vec<_>>();
            return Err(other("simulators of the members", ids(&old).join(", "), ids(&new).join(", ")));
        }
        Ok(folder)
    }

    fn open(path: &Path) -> Result<Self, EvaluationError> {
        let at = path.join(STUDY);
        let lock = File::open(&at).map_err(cannot_read(&at))?;
        // Where the file system knows no locks there is nothing to be done about it.
        if let Err(TryLockError::WouldBlock) = lock.try_lock() {
            return Err(EvaluationError::Busy { path: path.to_owned() });
        }
        Ok(Self { path: path.to_owned(), _lock: lock })
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The run folder of a member.
    pub fn member(&self, member: &Member) -> PathBuf {
        self.path.join(&member.folder)
    }

    /// The result of a member with which nothing is left to be done: finished without a failure, with all files.
    ///
    /// # Errors
    /// [`EvaluationError`] when a file is damaged.
    pub fn finished(&self, member: &Member, plan: &Provenance) -> Result<Option<Summary>, EvaluationError> {
        let folder = self.member(member);
        let with_rollouts = plan.keep_rollouts == Some(true);
        let mut wanted = vec![PROVENANCE, SUMMARY, TABLE, FAILURES];
        wanted.extend(with_rollouts.then_some(ROLLOUTS));
        if !wanted.iter().all(|name| folder.join(name).is_file()) {
            return Ok(None);
        }
        let summary = read_summary(&folder)?;
        let done = summary.provenance.failures.is_empty() && summary.is_of(&read_tally(&folder)?);
        Ok(done.then_some(summary))
    }

    /// Writes a file of the folder as a whole.
    ///
    /// # Errors
    /// [`EvaluationError::Write`]; the old file stays then.
    pub fn put(&self, name: &str, text: &str) -> Result<(), EvaluationError> {
        replace(&self.path.join(name), |out| out.write_all(text.as_bytes()))
    }
}

/// Whether a folder is absent or empty, or was left by a kill before the study began.
fn is_unbegun(path: &Path) -> bool {
    match fs::read_dir(path) {
        Ok(mut entries) => entries.all(|e| e.is_ok_and(|e| e.file_name() == "study.json.tmp")),
        Err(error) => error.kind() == io::ErrorKind::NotFound,
    }
}
