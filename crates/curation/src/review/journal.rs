//! The journal of decisions: an append-only file of lines.
//!
//! A line is written with one call and synchronised before it is confirmed, so a killed program loses
//! nothing that was confirmed. The rest of a torn last line is dropped.

mod decisions;
mod line;

#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::ReviewError;
use crate::Decision;

pub use decisions::{Decisions, Opinions};
pub use line::{ReviewLine, candidate_digest, is_reviewer};

/// The journal of one file of candidates, open for writing. Only one program at a time can open it.
#[derive(Debug)]
pub struct Journal {
    path: PathBuf,
    file: File,
    /// Length of all complete lines, bytes.
    length: u64,
    own: Decisions,
    merged: Decisions,
    /// The decision that each line replaced, by reviewer, for lines that can be undone.
    replaced: BTreeMap<String, Vec<PreviousDecision>>,
    warnings: Vec<String>,
}

/// The decision that was valid before a line.
#[derive(Clone, Debug)]
struct PreviousDecision {
    scenario_id: String,
    scenario_digest: String,
    before: Option<ReviewLine>,
}

impl Journal {
    /// Returns the journal's path for a file of candidates: `.reviews.jsonl` appended to its name.
    pub fn path_for(file: &Path) -> PathBuf {
        let mut name = file.as_os_str().to_owned();
        name.push(".reviews.jsonl");
        name.into()
    }

    /// Opens or creates a journal. A torn last line is cut off, with a message in [`Self::warnings`].
    ///
    /// # Errors
    /// When another program writes to it, when it cannot be read or written, or when a line is not a
    /// decision.
    pub fn open(path: &Path) -> Result<Self, ReviewError> {
        let refuse = |source| ReviewError::Write { path: path.to_owned(), source };
        let is_new = !path.exists();
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(refuse)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(ReviewError::Locked { path: path.to_owned() }),
            Err(TryLockError::Error(source)) => return Err(refuse(source)),
        }
        if is_new {
            sync_folder(path).map_err(refuse)?;
        }
        let found = read_from(path, &mut file)?;
        if found.whole_bytes < found.all_bytes {
            file.set_len(found.whole_bytes).and_then(|()| file.sync_data()).map_err(refuse)?;
        }
        let mut journal = Self {
            path: path.to_owned(),
            file,
            length: found.whole_bytes,
            own: Decisions::new(),
            merged: Decisions::new(),
            replaced: BTreeMap::new(),
            warnings: found.warning.into_iter().collect(),
        };
        if found.unended {
            journal.write(b"\n")?;
        }
        for line in found.lines {
            journal.take(line);
        }
        Ok(journal)
    }

    /// Adds the decisions of other reviewers; their journals are only read.
    ///
    /// # Errors
    /// When one cannot be read or has a line that is not a decision.
    pub fn merge<P: AsRef<Path>>(&mut self, others: &[P]) -> Result<(), ReviewError> {
        let (found, warnings) = decisions::of_files(others)?;
        decisions::merge(&mut self.merged, &found);
        self.warnings.extend(warnings);
        Ok(())
    }

    /// Reads the decisions of several journals without locking or changing them, together with warnings
    /// for the user. Other programs may be writing to them.
    ///
    /// # Errors
    /// When one cannot be read or has a line that is not a decision.
    pub fn read_all<P: AsRef<Path>>(paths: &[P]) -> Result<(Decisions, Vec<String>), ReviewError> {
        decisions::of_files(paths)
    }

    /// Returns the path of the journal.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns warnings from opening for the user.
    pub fn warnings(&self) -> &[String] {
        &self.warnings
    }

    /// Writes a decision. It is on disk when this returns.
    ///
    /// # Errors
    /// When it is invalid or cannot be written; then it does not count.
    pub fn append(&mut self, line: ReviewLine) -> Result<(), ReviewError> {
        line.check()?;
        let mut text = serde_json::to_vec(&line)
            .map_err(|e| ReviewError::Write { path: self.path.clone(), source: e.into() })?;
        text.push(b'\n');
        self.write(&text)?;
        self.take(line);
        Ok(())
    }

    /// Undoes the last decision of a reviewer in this journal that was not undone yet, by writing the
    /// previous one again. Returns the new line, or `None` if there is nothing left to undo.
    ///
    /// # Errors
    /// As for [`Self::append`].
    pub fn undo(&mut self, reviewer: &str, at: String) -> Result<Option<ReviewLine>, ReviewError> {
        let Some(last) = self.replaced.get(reviewer).and_then(|lines| lines.last()).cloned() else {
            return Ok(None);
        };
        let line = match last.before {
            Some(before) => ReviewLine { at, undo: true, ..before },
            None => ReviewLine {
                scenario_id: last.scenario_id,
                scenario_digest: last.scenario_digest,
                candidate: None,
                candidate_digest: None,
                decision: Decision::Clear,
                reviewer: reviewer.to_owned(),
                at,
                note: None,
                undo: true,
            },
        };
        self.append(line.clone())?;
        Ok(Some(line))
    }

    /// Returns the last decision of every reviewer, merged journals included.
    pub fn decisions(&self) -> Decisions {
        let mut all = self.own.clone();
        decisions::merge(&mut all, &self.merged);
        all
    }

    /// Returns the decisions about one scenario.
    pub fn opinions(&self, scenario_id: &str) -> Opinions {
        let mut all = Decisions::new();
        for decisions in [&self.own, &self.merged] {
            if let Some(opinions) = decisions.get(scenario_id) {
                decisions::merge(&mut all, &BTreeMap::from([(scenario_id.to_owned(), opinions.clone())]));
            }
        }
        all.remove(scenario_id).unwrap_or_default()
    }

    /// Returns the reviewer of the latest line of this journal.
    pub fn last_reviewer(&self) -> Option<&str> {
        let lines = self.own.values().flat_map(|opinions| opinions.0.values());
        lines.max_by(|a, b| a.at.cmp(&b.at)).map(|line| line.reviewer.as_str())
    }

    /// Appends bytes after the complete lines, all or nothing.
    fn write(&mut self, bytes: &[u8]) -> Result<(), ReviewError> {
        let length = self.length;
        let write = |file: &mut File| {
            file.seek(SeekFrom::Start(length))?;
            file.write_all(bytes)?;
            file.sync_data()
        };
        if let Err(source) = write(&mut self.file) {
            // A full disk leaves a partial line; the next one must not be joined to it.
            self.file.set_len(length).ok();
            return Err(ReviewError::Write { path: self.path.clone(), source });
        }
        self.length += bytes.len() as u64;
        Ok(())
    }

    fn take(&mut self, line: ReviewLine) {
        let opinions = self.own.entry(line.scenario_id.clone()).or_default();
        let lines = self.replaced.entry(line.reviewer.clone()).or_default();
        if line.undo {
            lines.pop();
        } else {
            let before = opinions.0.get(&line.reviewer).cloned();
            let (scenario_id, scenario_digest) = (line.scenario_id.clone(), line.scenario_digest.clone());
            lines.push(PreviousDecision { scenario_id, scenario_digest, before });
        }
        opinions.take(line);
    }
}

/// Synchronises the folder of a new file: only then is its entry on disk.
fn sync_folder(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    // Elsewhere folders cannot be opened, and need not be.
    if cfg!(unix) { File::open(folder)?.sync_all() } else { Ok(()) }
}

/// Content of a journal.
struct JournalContent {
    lines: Vec<ReviewLine>,
    whole_bytes: u64,
    all_bytes: u64,
    /// Whether the last line is complete except for its line break.
    unended: bool,
    warning: Option<String>,
}

fn read(path: &Path) -> Result<JournalContent, ReviewError> {
    let refuse = |source| ReviewError::Read { path: path.to_owned(), source };
    read_from(path, &mut File::open(path).map_err(refuse)?)
}

fn read_from(path: &Path, file: &mut File) -> Result<JournalContent, ReviewError> {
    let mut content = Vec::new();
    let refuse = |source| ReviewError::Read { path: path.to_owned(), source };
    file.read_to_end(&mut content).map_err(refuse)?;
    let mut found = JournalContent {
        lines: Vec::new(),
        whole_bytes: 0,
        all_bytes: content.len() as u64,
        unended: false,
        warning: None,
    };
    for (i, bytes) in content.split_inclusive(|&b| b == b'\n').enumerate() {
        let ended = bytes.ends_with(b"\n");
        match parse(bytes.trim_ascii()) {
            Ok(line) => found.lines.extend(line),
            Err(_) if !ended => {
                found.warning = Some(format!(
                    "{}, line {}: incomplete, as after a crash; \
                     this decision was never confirmed and is dropped",
                    path.display(),
                    i + 1
                ));
                break;
            }
            Err(what) => {
                return Err(ReviewError::Line { path: path.to_owned(), line: i + 1, found: what });
            }
        }
        found.unended = !ended;
        found.whole_bytes += bytes.len() as u64;
    }
    Ok(found)
}

/// Parses one line; `None` if it is empty.
fn parse(bytes: &[u8]) -> Result<Option<ReviewLine>, String> {
    if bytes.is_empty() {
        return Ok(None);
    }
    let line: ReviewLine = serde_json::from_slice(bytes).map_err(|e| format!("not a decision: {e}"))?;
    line.check().map_err(|e| e.to_string())?;
    Ok(Some(line))
}

impl Drop for Journal {
    fn drop(&mut self) {
        // Closing alone would leave the lock with a process that was being started meanwhile and still
        // shares the file.
        self.file.unlock().ok();
    }
}
