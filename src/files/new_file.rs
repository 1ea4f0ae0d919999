//! A file that gets its name when it is complete.

use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;

/// Suffix of the name of a file that is being written.
const SUFFIX: &str = ".partial";

/// A file that is being written under a temporary name in the folder of its target. [`NewFile::finish`] gives
/// it its name; dropped before, it is removed. An existing file of that name stays as it is until then.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    partial: PathBuf,
    file: BufWriter<File>,
}

impl NewFile {
    /// Begins a file.
    ///
    /// # Errors
    /// The error of the system; also if the path has no file name, or is a folder or another thing that is
    /// not a regular file.
    pub fn create(path: &Path) -> io::Result<Self> {
        let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if path.exists() && !path.is_file() {
            return Err(io::Error::other("it exists and is not a regular file; choose another name"));
        }
        let partial = path.with_file_name(format!(".{}.{}{SUFFIX}", name.display(), process::id()));
        let file = BufWriter::new(File::create(&partial)?);
        Ok(Self { path: path.to_owned(), partial, file })
    }

    /// Writes everything to the disk and gives the file its name.
    ///
    /// # Errors
    /// The error of the system; the partial file is removed.
    pub fn finish(mut self) -> io::Result<()> {
        self.file.flush()?;
        self.file.get_ref().sync_all()?;
        fs::rename(&self.partial, &self.path)?;
        // The folder holds the name. Some systems cannot synchronise folders; the file is complete anyway.
        let folder = self.path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
        if let Ok(folder) = File::open(folder) {
            folder.sync_all().ok();
        }
        Ok(())
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // Fails if the file has its name: nothing is left to remove then.
        fs::remove_file(&self.partial).ok();
    }
}

/// Writes a file as a whole, or not at all.
///
/// # Errors
/// As for [`NewFile`], and those of `write`.
pub fn replace(path: &Path, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> io::Result<()> {
    let mut file = NewFile::create(path)?;
    write(&mut file)?;
    file.finish()
}

/// Returns the name of the file for which a partial file was begun; `None` if this is no name of a partial
/// file. A killed process leaves such files behind.
pub fn target_of(partial: &str) -> Option<&str> {
    let (target, process) = partial.strip_prefix('.')?.strip_suffix(SUFFIX)?.rsplit_once('.')?;
    let is_number = !process.is_empty() && process.bytes().all(|b| b.is_ascii_digit());
    (is_number && !target.is_empty()).then_some(target)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_when_it_is_complete() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"one").unwrap();
        let names: Vec<String> = fs::read_dir(folder.path())
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        assert_eq!(names.iter().map(|n| target_of(n)).collect::<Vec<_>>(), [Some("a.txt")]);
        file.finish().unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"one");

        // A failure leaves the old file and nothing else.
        let failed = replace(&path, |out| {
            out.write_all(b"two")?;
            Err(io::Error::other("no more"))
        });
        assert_eq!(failed.unwrap_err().to_string(), "no more");
        assert_eq!(fs::read(&path).unwrap(), b"one");
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
        replace(&path, |out| out.write_all(b"two")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
    }

    #[test]
    fn folders_are_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        for path in [folder.path(), Path::new("/"), Path::new("..")] {
            assert!(NewFile::create(path).is_err());
        }
    }

    #[test]
    fn names_of_partial_files_are_recognised() {
        assert_eq!(target_of(".rows.jsonl.12.partial"), Some("rows.jsonl"));
        for other in ["rows.jsonl.12.partial", ".rows.partial", ".rows.x.partial", ".12.partial", ".rows.12"]
        {
            assert_eq!(target_of(other), None, "{other}");
        }
    }
}
