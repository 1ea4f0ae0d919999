//! Writing of submissions.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use flate2::Compression;
use flate2::write::GzEncoder;
use reactsim_files::NewFile;
use reactsim_scene::wosac::ScenarioRollouts;
use tar::{Builder, Header};

use super::metadata::SubmissionMetadata;
use super::rollouts::encode_rollouts;
use super::shards::shard_name;
use crate::error::{Cause, FormatError};
use crate::wire::Message;

/// Maximum length of a file in bytes: decoders of the server read at most 2 GB.
const MAX_SHARD_LENGTH: u64 = 2_000_000_000;
/// Tag of the rollouts.
const ROLLOUTS_TAG: u32 = 1;
/// Permissions of the files in the archive.
const MODE: u32 = 0o644;

/// Writer of a submission: a `.tar.gz` archive of files with the rollouts of many scenarios each. One file is
/// on disk next to the archive at a time, one scenario in memory. The archive appears when it is complete.
pub struct SubmissionWriter {
    path: PathBuf,
    /// Name of the files before `.binproto`.
    name: String,
    metadata: Vec<u8>,
    archive: Builder<GzEncoder<NewFile>>,
    shard: Option<(NewFile, u64)>,
    next: u32,
    count: u32,
}

impl SubmissionWriter {
    /// Begins a submission of `count` files (customarily one per file of the data set, 150), which are named
    /// `name`.
    ///
    /// # Errors
    /// The path does not end with `.tar.gz`, the metadata lack a required field, or the file cannot be
    /// created.
    pub fn create(
        path: &Path,
        name: &str,
        count: u32,
        metadata: &SubmissionMetadata,
    ) -> Result<Self, FormatError> {
        let refuse = |cause| FormatError::file(path, cause);
        let file_name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        if !file_name.ends_with(".tar.gz") {
            let expected = "a name that ends with `.tar.gz`, which the server requires";
            return Err(refuse(Cause::value("the name", format!("`{file_name}`"), expected)));
        }
        if name.is_empty() || name.contains(['/', '\\']) || name.len() > 60 {
            let expected = "1 to 60 characters without slashes";
            return Err(refuse(Cause::value("the name of the files", format!("`{name}`"), expected)));
        }
        if count == 0 || count > 99_999 {
            return Err(refuse(Cause::value("the number of files", count, "1 to 99999")));
        }
        metadata.check().map_err(refuse)?;
        let file = NewFile::create(path).map_err(|e| refuse(Cause::write(e)))?;
        Ok(Self {
            path: path.to_owned(),
            name: name.to_owned(),
            metadata: metadata.encode(),
            // Trajectories hardly compress.
            archive: Builder::new(GzEncoder::new(file, Compression::fast())),
            shard: None,
            next: 0,
            count,
        })
    }

    /// Writes the rollouts of a scenario to the current file. They are not validated; see
    /// [`check_rollouts`](reactsim_scene::wosac::check_rollouts).
    ///
    /// # Errors
    /// All files are finished, the file would be longer than 2 GB, or writing failed.
    pub fn write(&mut self, rollouts: &ScenarioRollouts) -> Result<(), FormatError> {
        let mut message = Message::default();
        message.bytes(ROLLOUTS_TAG, encode_rollouts(rollouts));
        self.append(&message.into_bytes())
    }

    fn append(&mut self, fields: &[u8]) -> Result<(), FormatError> {
        if self.next == self.count {
            let expected = format!("at most {}, as stated at the beginning", self.count);
            return Err(self.error(Cause::value("the number of files", self.next + 1, expected)));
        }
        if self.shard.is_none() {
            let file = NewFile::create(&self.shard_path()).map_err(|e| self.error(Cause::write(e)))?;
            self.shard = Some((file, 0));
        }
        let Some((file, length)) = &mut self.shard else { return Ok(()) };
        *length += fields.len() as u64;
        let is_too_long = *length + self.metadata.len() as u64 > MAX_SHARD_LENGTH;
        let written = file.write_all(fields);
        if is_too_long {
            let found = format!("more than {MAX_SHARD_LENGTH} bytes");
            return Err(self.error(Cause::value("the length of a file", found, "less; write more files")));
        }
        written.map_err(|e| self.error(Cause::write(e)))
    }

    /// Finishes the current file, which may have no scenario, and begins the next one.
    ///
    /// # Errors
    /// All files are finished, or writing failed.
    pub fn finish_shard(&mut self) -> Result<(), FormatError> {
        let metadata = self.metadata.clone();
        self.append(&metadata)?;
        let Some((file, length)) = self.shard.take() else { return Ok(()) };
        let (path, mut header) = (self.shard_path(), Header::new_ustar());
        header.set_size(length);
        header.set_mode(MODE);
        let name = shard_name(&self.name, self.next, self.count);
        let archive = &mut self.archive;
        let archived = file.finish().and_then(|()| {
            let appended = File::open(&path).and_then(|file| archive.append_data(&mut header, name, file));
            fs::remove_file(&path).and(appended)
        });
        self.next += 1;
        archived.map_err(|e| self.error(Cause::write(e)))
    }

    /// Finishes the remaining files and the archive.
    ///
    /// # Errors
    /// Writing failed; the archive does not exist then.
    pub fn finish(mut self) -> Result<(), FormatError> {
        while self.next < self.count {
            self.finish_shard()?;
        }
        let refuse = |e| FormatError::file(&self.path, Cause::write(e));
        let file = self.archive.into_inner().and_then(GzEncoder::finish);
        file.and_then(NewFile::finish).map_err(refuse)
    }

    /// Returns the path of the file that is being written, next to the archive.
    fn shard_path(&self) -> PathBuf {
        let archive = self.path.file_name().unwrap_or_default().to_string_lossy().into_owned();
        self.path.with_file_name(format!(".{archive}.shard"))
    }

    fn error(&self, cause: Cause) -> FormatError {
        FormatError::file(&self.path, cause)
    }
}
