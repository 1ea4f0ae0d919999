//! Files that are written completely or not at all.

use std::fs::{self, File};
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};

use crate::evaluation::FileRecord;

/// A file that gets its name when it is complete; if dropped before, it is removed.
pub(super) struct NewFile {
    path: PathBuf,
    partial: PathBuf,
    file: File,
}

impl NewFile {
    /// Begins a file. An existing file stays as it is until the new one is complete.
    pub(super) fn create(path: &Path) -> anyhow::Result<Self> {
        let name = || format!("could not write {}", path.display());
        if path.exists() && !path.is_file() {
            bail!("{}: it exists and is not a regular file; choose another name", name());
        }
        let file_name = path.file_name().with_context(name)?;
        let partial = path.with_file_name(format!(".{}.{}.partial", file_name.display(), std::process::id()));
        let file = File::create(&partial).with_context(name)?;
        Ok(Self { path: path.to_owned(), partial, file })
    }

    /// Writes the content and gives the file its name.
    pub(super) fn finish(mut self, bytes: &[u8]) -> anyhow::Result<FileRecord> {
        let written = self.file.write_all(bytes).and_then(|()| self.file.sync_all());
        written
            .and_then(|()| fs::rename(&self.partial, &self.path))
            .with_context(|| format!("could not write {}", self.path.display()))?;
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        Ok(FileRecord::of_content(&name, "safetensors", bytes))
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // Fails if the file got its name: there is nothing to remove then.
        let _ = fs::remove_file(&self.partial);
    }
}
