//! Records of files: name, size and digest.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use reactsim_files::{FileDigest, digest, name_of};
use reactsim_formats::{CurrentFrames, FutureChoice, Input, LengthChoice};
use serde::{Deserialize, Serialize};

use crate::error::EvaluationError;

/// A file of a run.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Name without its folder, so that moving the folder does not change the input.
    pub name: String,
    /// Id of its format.
    pub format: String,
    /// Size, bytes.
    pub bytes: u64,
    /// BLAKE3 digest of its content.
    pub blake3: String,
    /// The requested current frame; absent if it is the one defined by the format.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub current_frame: Option<usize>,
    /// The number of frames between the current frames of windows; absent if recordings give one scenario.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub window_step: Option<NonZeroUsize>,
    /// The requested number of frames up to the current one; absent if none was requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub history: Option<usize>,
    /// The requested number of frames after the current one; absent if none was requested.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub future: Option<FutureChoice>,
    /// Whether all agents are simulated, of all kinds and any number.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub all_agents: bool,
    /// Of a file of deviated AVs, the digest of the trajectories in it, without what made them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub trajectories: Option<String>,
    /// Other files from which its scenarios are read, such as maps.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub companions: Vec<CompanionRecord>,
}

/// An additional file from which the scenarios of another file are read.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CompanionRecord {
    /// Name without its folder.
    pub name: String,
    /// Size, bytes.
    pub bytes: u64,
    /// BLAKE3 digest of its content.
    pub blake3: String,
}

impl FileRecord {
    /// Creates the record of a file, which is read to its end for size and digest.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] names the file.
    pub fn of(path: &Path, format: &str) -> Result<Self, EvaluationError> {
        let CompanionRecord { name, bytes, blake3 } = CompanionRecord::of(path)?;
        Ok(Self { name, format: format.to_owned(), bytes, blake3, ..Self::default() })
    }

    /// Creates the record of a file whose content is embedded in the program.
    pub fn of_content(name: &str, format: &str, content: &[u8]) -> Self {
        Self {
            name: name.to_owned(),
            format: format.to_owned(),
            bytes: content.len() as u64,
            blake3: blake3::hash(content).to_hex().to_string(),
            ..Self::default()
        }
    }

    /// Creates the record of an input that is not read: without size, digest and companions.
    pub(crate) fn unread(input: &Input) -> Self {
        let (current_frame, window_step) = match input.frames {
            CurrentFrames::Stated => (None, None),
            CurrentFrames::At(frame) => (Some(frame), None),
            CurrentFrames::Every(step) => (None, Some(step)),
        };
        Self {
            name: name_of(&input.path).into_owned(),
            format: input.format.id().to_owned(),
            current_frame,
            window_step,
            history: input.length.history,
            future: input.length.future,
            all_agents: input.all_agents,
            ..Self::default()
        }
    }

    /// Returns whether both give the same scenarios or the same deviated AVs. Names may differ, and so may
    /// the program that made the deviated AVs.
    pub fn is_same(&self, other: &Self) -> bool {
        self.digest() == other.digest()
            || self.trajectories.is_some() && self.trajectories == other.trajectories
    }

    /// Returns whether its scenarios are read as the format defines them.
    pub(crate) fn is_plain(&self) -> bool {
        self.frames() == CurrentFrames::Stated && self.length().is_default() && !self.all_agents
    }

    /// Returns the current frames with which its recordings are read.
    pub fn frames(&self) -> CurrentFrames {
        current_frames(self.current_frame, self.window_step)
    }

    /// Returns the number of frames with which its scenarios are read.
    pub fn length(&self) -> LengthChoice {
        LengthChoice { history: self.history, future: self.future }
    }

    /// Returns the digest of everything that determines the scenarios: the content, and the current frame,
    /// the length and companions if there are any.
    pub fn digest(&self) -> String {
        if self.is_plain() && self.companions.is_empty() {
            return self.blake3.clone();
        }
        let mut hasher = blake3::Hasher::new();
        hasher.update(self.blake3.as_bytes());
        hasher.update(format!(" {:?}", self.current_frame).as_bytes());
        if let Some(step) = self.window_step {
            hasher.update(format!(" every {step}").as_bytes());
        }
        if !self.length().is_default() {
            hasher.update(format!(" {:?}", self.length()).as_bytes());
        }
        if self.all_agents {
            hasher.update(b" all agents");
        }
        for companion in &self.companions {
            hasher.update(companion.blake3.as_bytes());
        }
        hasher.finalize().to_hex().to_string()
    }
}

/// Returns the current frames of a file: the requested frame, every `step`-th frame, or the recorded ones.
pub(crate) fn current_frames(frame: Option<usize>, step: Option<NonZeroUsize>) -> CurrentFrames {
    match (frame, step) {
        (Some(frame), _) => CurrentFrames::At(frame),
        (None, Some(step)) => CurrentFrames::Every(step),
        (None, None) => CurrentFrames::Stated,
    }
}

impl CompanionRecord {
    /// Creates the record of a file, which is read to its end.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] names the file.
    pub fn of(path: &Path) -> Result<Self, EvaluationError> {
        let read = |source| EvaluationError::Read { path: path.to_owned(), source };
        let FileDigest { bytes, blake3 } = digest(path).map_err(read)?;
        Ok(Self { name: name_of(path).into_owned(), bytes, blake3 })
    }
}

/// Creates the records of inputs. Files that several of them share, such as maps, are read once.
#[derive(Default)]
pub struct Registrar {
    companions: BTreeMap<PathBuf, CompanionRecord>,
}

impl Registrar {
    /// Creates the record of an input with all files that it is read from.
    ///
    /// # Errors
    /// [`EvaluationError::Read`] names the file that cannot be read. A missing companion is not an error
    /// here: reading the scenarios will report it.
    pub fn record(&mut self, input: &Input) -> Result<FileRecord, EvaluationError> {
        let CompanionRecord { name, bytes, blake3 } = CompanionRecord::of(&input.path)?;
        let mut record = FileRecord { name, bytes, blake3, ..FileRecord::unread(input) };
        for path in input.companions() {
            if let Some(known) = self.companions.get(&path) {
                record.companions.push(known.clone());
            } else if path.is_file() {
                let companion = CompanionRecord::of(&path)?;
                self.companions.insert(path, companion.clone());
                record.companions.push(companion);
            }
        }
        Ok(record)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_requested_lengths_are_recorded() {
        let usual = FileRecord::of_content("a", "native", b"x");
        let text = serde_json::to_string(&usual).unwrap();
        assert_eq!(
            text,
            format!(r#"{{"name":"a","format":"native","bytes":1,"blake3":"{}"}}"#, usual.blake3),
            "as before lengths could be requested"
        );
        assert!(usual.is_plain() && usual.length().is_default() && usual.digest() == usual.blake3);
        let long = FileRecord { history: Some(21), future: Some(FutureChoice::Log), ..usual.clone() };
        let text = serde_json::to_string(&long).unwrap();
        assert!(text.contains(r#""history":21,"future":"log""#), "{text}");
        assert_eq!(serde_json::from_str::<FileRecord>(&text).unwrap(), long);
        let other = FileRecord { future: Some(FutureChoice::Steps(150)), ..long.clone() };
        assert!(!long.is_plain() && !long.is_same(&usual) && !long.is_same(&other));
    }
}
