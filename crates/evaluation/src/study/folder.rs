//! The folder of a study: how it is created, and how it resumes after an interruption.

use std::path::{Path, PathBuf};

use reactsim_files::FolderLock;

use super::file::read;
use super::{Member, Study, StudyPlan};
use crate::error::EvaluationError;
use crate::folder::{
    RunFolder, is_unbegun, lock, lock_unbegun, read_summary, read_tally, replace, write_json,
};
use crate::layout::{FAILURES, PROVENANCE, ROLLOUTS, STUDY, SUMMARY, TABLE};
use crate::provenance::Provenance;
use crate::statistics::tally::Tally;
use crate::summary::Summary;

/// The folder of a study that is running.
#[derive(Debug)]
pub struct StudyFolder {
    path: PathBuf,
    /// Lock held during the study: two programs must not write to one folder.
    _lock: FolderLock,
}

impl StudyFolder {
    /// Creates a folder for a new study. It may exist if it is empty.
    ///
    /// # Errors
    /// [`EvaluationError`] if the folder is not empty or cannot be written.
    pub fn create(path: &Path, study: &Study) -> Result<Self, EvaluationError> {
        Self::begin(path, lock_unbegun(path, STUDY)?, study)
    }

    /// Opens the folder of an earlier study with the same members and settings. Settings of members that have
    /// not begun are not checked.
    ///
    /// # Errors
    /// [`EvaluationError`] if the folder has no study, a study of another kind, or a run with other settings;
    /// names the setting.
    pub fn resume(path: &Path, plan: &mut StudyPlan) -> Result<Self, EvaluationError> {
        if !is_unbegun(path, STUDY) {
            // A refused folder is not written to.
            read(path)?;
        }
        let lock = lock(path)?;
        if is_unbegun(path, STUDY) {
            return Self::begin(path, lock, plan.study());
        }
        let old = read(path)?;
        let folder = Self { path: path.to_owned(), _lock: lock };
        let other = |setting: &str, old: &str, new: &str| {
            Err(EvaluationError::other_settings(path, setting, old, new))
        };
        let new = plan.study().clone();
        if old.kind != new.kind {
            return other("study", old.kind.name(), new.kind.name());
        }
        for (i, member) in new.members.iter().enumerate() {
            let provenance = plan.select(i).provenance();
            RunFolder::is_of(&folder.member(member), &provenance)?;
        }
        if old != new {
            let names =
                |of: &Study| of.members.iter().map(|m| m.folder.as_str()).collect::<Vec<_>>().join(", ");
            if names(&old) != names(&new) {
                return other("members", &names(&old), &names(&new));
            }
            let ids =
                |of: &Study| of.members.iter().flat_map(|m| m.originals.keys().cloned()).collect::<Vec<_>>();
            return other("simulators of the members", &ids(&old).join(", "), &ids(&new).join(", "));
        }
        Ok(folder)
    }

    fn begin(path: &Path, lock: FolderLock, study: &Study) -> Result<Self, EvaluationError> {
        write_json(&path.join(STUDY), study)?;
        Ok(Self { path: path.to_owned(), _lock: lock })
    }

    /// Returns the path of the folder.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the run folder of a member.
    pub fn member(&self, member: &Member) -> PathBuf {
        self.path.join(&member.folder)
    }

    /// Returns the result of a member if it is complete: finished without a failure, with all files.
    ///
    /// # Errors
    /// [`EvaluationError`] if a file is damaged.
    pub fn finished(&self, member: &Member, plan: &Provenance) -> Result<Option<Summary>, EvaluationError> {
        let folder = self.member(member);
        let with_rollouts = plan.keep_rollouts == Some(true);
        let mut required = vec![PROVENANCE, SUMMARY, TABLE, FAILURES];
        required.extend(with_rollouts.then_some(ROLLOUTS));
        if !required.iter().all(|name| folder.join(name).is_file()) {
            return Ok(None);
        }
        let summary = read_summary(&folder)?;
        // A member with damaged or missing rows is run again as far as is necessary.
        let complete = |tally: &Tally| summary.provenance.failures.is_empty() && summary.is_of(tally);
        let is_done = match read_tally(&folder) {
            Err(EvaluationError::DamagedLine { .. } | EvaluationError::IncompleteRows { .. }) => false,
            read => complete(&read?),
        };
        Ok(is_done.then_some(summary))
    }

    /// Writes a file of the folder atomically.
    ///
    /// # Errors
    /// [`EvaluationError::Write`]; the old file is then left unchanged.
    pub fn put(&self, name: &str, text: &str) -> Result<(), EvaluationError> {
        replace(&self.path.join(name), |out| out.write_all(text.as_bytes()))
    }
}
