//! Tensor files that commands write.

use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use safetensors::SafeTensors;

use crate::evaluation::FileRecord;
use crate::files::{NewFile, read_regular};

/// A tensor file that gets its name when it is complete. It is begun before the work that fills it, so that a
/// name that cannot be written is reported at once.
pub(super) struct TensorFile {
    path: PathBuf,
    file: NewFile,
}

impl TensorFile {
    /// Begins a file. An existing file of tensors stays as it is until the new one is complete; any other is
    /// refused.
    pub(super) fn create(path: &Path) -> anyhow::Result<Self> {
        let is_tensors = |bytes: &[u8]| bytes.is_empty() || SafeTensors::read_metadata(bytes).is_ok();
        if path.is_file() && !read_regular(path).is_ok_and(|bytes| is_tensors(&bytes)) {
            bail!("{}: there is another file of this name; remove it or choose another name", path.display());
        }
        let file = NewFile::create(path).with_context(|| format!("could not write {}", path.display()))?;
        Ok(Self { path: path.to_owned(), file })
    }

    /// Writes the content and gives the file its name.
    pub(super) fn finish(mut self, bytes: &[u8]) -> anyhow::Result<FileRecord> {
        let written = self.file.write_all(bytes).and_then(|()| self.file.finish());
        written.with_context(|| format!("could not write {}", self.path.display()))?;
        let name = self.path.file_name().unwrap_or_default().to_string_lossy();
        Ok(FileRecord::of_content(&name, "safetensors", bytes))
    }
}
