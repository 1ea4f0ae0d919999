//! A file that gets its name when it is complete.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::process;
use std::time::Duration;

use super::regular::open_local;
use super::url::refuse_url;

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
    /// The error of the system; also if the path is a URL, has no file name, or is a folder or another thing
    /// that is not a regular file.
    pub fn create(path: &Path) -> io::Result<Self> {
        refuse_url(path)?;
        let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        if path.is_dir() {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if path.exists() && !path.is_file() {
            return Err(io::Error::other("it exists and is not a regular file; choose another name"));
        }
        remove_abandoned(path);
        let partial = path.with_file_name(format!(".{}.{}{SUFFIX}", name.display(), process::id()));
        let file = File::create(&partial)?;
        // The lock shows that the file is not abandoned. On file systems without locks it stays if this
        // process is killed.
        file.try_lock().ok();
        Ok(Self { path: path.to_owned(), partial, file: BufWriter::new(file) })
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

/// Age from which an unlocked partial file counts as abandoned: a new one is not yet locked.
const MIN_AGE: Duration = Duration::from_secs(2);

/// Removes partial files for this target whose processes were killed. Files that cannot be removed only take
/// space.
fn remove_abandoned(path: &Path) {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        if name.to_str().and_then(target_of).map(OsStr::new) != path.file_name() {
            continue;
        }
        let is_old = |file: &File| -> io::Result<bool> {
            Ok(file.metadata()?.modified()?.elapsed().is_ok_and(|age| age >= MIN_AGE))
        };
        if let Ok(file) = open_local(&entry.path())
            && is_old(&file).unwrap_or(false)
            && file.try_lock().is_ok()
        {
            fs::remove_file(entry.path()).ok();
        }
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
    fn files_of_killed_processes_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let (path, other) = (folder.path().join("a.txt"), folder.path().join(".b.txt.1.partial"));
        let abandoned = folder.path().join(".a.txt.1.partial");
        let begin = |path: &Path, age: u64| {
            let file = File::create(path).unwrap();
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(age)).unwrap();
            file
        };
        let locked = begin(&abandoned, 60);
        locked.try_lock().unwrap();
        begin(&other, 60);
        replace(&path, |out| out.write_all(b"one")).unwrap();
        assert!(abandoned.exists(), "somebody writes it");
        drop(locked);
        begin(&abandoned, 0);
        replace(&path, |out| out.write_all(b"two")).unwrap();
        assert!(abandoned.exists(), "somebody has just begun it");
        begin(&abandoned, 60);
        replace(&path, |out| out.write_all(b"three")).unwrap();
        assert!(!abandoned.exists() && other.exists());
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
