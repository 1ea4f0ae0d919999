//! A file that gets its name when it is complete.

use std::ffi::{OsStr, OsString};
use std::fs::{self, File, Metadata};
use std::io::{self, BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rand::TryRng;

use super::folder::{Folder, folder_of};
use super::kind::{HEAD, kind_at, kind_of};
use super::regular::open_local;
use super::url::refuse_url;

/// Suffix of the name of a file that is being written.
const SUFFIX: &str = ".partial";
/// Number of random hexadecimal digits in such a name.
const DIGITS: usize = 16;
/// Number of random names to try. The second is needed only if somebody has created the first.
const ATTEMPTS: u32 = 8;

/// A file that is being written under a temporary name in the folder of its target. [`NewFile::finish`] gives
/// it its name; dropped before, it is removed. An existing file of that name stays as it is until then, and
/// for good if its content is of another kind, such as Parquet where a picture is written. Its mode is kept,
/// and a link is followed.
#[derive(Debug)]
pub struct NewFile {
    path: PathBuf,
    folder: Folder,
    partial: OsString,
    file: BufWriter<File>,
    /// Kind of the content that is replaced, if there is some.
    old: Option<&'static str>,
    /// First bytes of the new content.
    head: Vec<u8>,
}

impl NewFile {
    /// Begins a file.
    ///
    /// # Errors
    /// The error of the system; also if the path is a URL, has no file name, or is a folder, another thing
    /// that is not a regular file, or a link to nothing.
    pub fn create(path: &Path) -> io::Result<Self> {
        refuse_url(path)?;
        let path = follow(path)?;
        let name = path.file_name().ok_or(io::ErrorKind::InvalidFilename)?;
        let old = path.metadata().ok();
        if old.as_ref().is_some_and(Metadata::is_dir) {
            return Err(io::ErrorKind::IsADirectory.into());
        }
        if old.as_ref().is_some_and(|old| !old.is_file()) {
            return Err(io::Error::other("it exists and is not a regular file; choose another name"));
        }
        remove_abandoned(folder_of(&path), Some(name));
        let folder = Folder::open(folder_of(&path))?;
        let (partial, file) = begin(&folder, name)?;
        // The lock shows that the file is not abandoned. On file systems without locks it stays if this
        // process is killed.
        file.try_lock().ok();
        let file = BufWriter::new(file);
        let kind = old.as_ref().and_then(|_| kind_at(&path));
        let new = Self { path, folder, partial, file, old: kind, head: Vec::new() };
        if let Some(old) = old {
            keep_mode(&old, new.file.get_ref());
        }
        Ok(new)
    }

    /// Writes everything to the disk and gives the file its name.
    ///
    /// # Errors
    /// The error of the system; the partial file is removed.
    pub fn finish(self) -> io::Result<()> {
        let name = self.path.file_name().unwrap_or_default().to_owned();
        self.finish_as(&name)
    }

    /// Writes everything to the disk and gives the file the name of a part ([`interrupted`]), which is
    /// returned. An existing file of the name that was asked for stays.
    ///
    /// # Errors
    /// The error of the system; the partial file is removed.
    pub fn finish_part(self) -> io::Result<PathBuf> {
        let path = interrupted(&self.path);
        self.finish_as(path.file_name().unwrap_or_default())?;
        Ok(path)
    }

    fn finish_as(mut self, name: &OsStr) -> io::Result<()> {
        self.refuse_other_kind()?;
        self.file.flush()?;
        self.file.get_ref().sync_all()?;
        self.folder.rename(&self.partial, name)?;
        self.folder.sync();
        Ok(())
    }

    /// Refuses content of another kind than that of the file that it would replace.
    fn refuse_other_kind(&self) -> io::Result<()> {
        match (self.old, kind_of(&self.head)) {
            (Some(old), Some(new)) if old != new => Err(io::Error::other(format!(
                "it contains {old}, which {new} would replace; choose another name, or remove the file first"
            ))),
            _ => Ok(()),
        }
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.file.write(bytes)?;
        let missing = HEAD - self.head.len();
        if missing > 0 {
            self.head.extend_from_slice(&bytes[..n.min(missing)]);
            if self.head.len() == HEAD {
                self.refuse_other_kind()?;
            }
        }
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Reads what is written so far.
impl Read for NewFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        self.file.flush()?;
        self.file.get_mut().read(buffer)
    }
}

impl Seek for NewFile {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.file.seek(position)
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        // Fails if the file has its name: nothing is left to remove then.
        self.folder.remove(&self.partial).ok();
    }
}

/// Returns the path of a part of a file, which an interrupted command leaves: `a.interrupted.parquet` for
/// `a.parquet`.
pub fn interrupted(path: &Path) -> PathBuf {
    let mut name = path.file_stem().unwrap_or_default().to_owned();
    name.push(".interrupted");
    if let Some(extension) = path.extension() {
        name.push(".");
        name.push(extension);
    }
    path.with_file_name(name)
}

/// Returns the file that a link leads to, or else the path itself.
fn follow(path: &Path) -> io::Result<PathBuf> {
    if !path.is_symlink() {
        return Ok(path.to_owned());
    }
    path.canonicalize().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => {
            let text = "it is a link to a file that does not exist; remove the link, or choose another name";
            io::Error::new(error.kind(), text)
        }
        _ => error,
    })
}

/// Creates a file with a name that nobody can have foreseen, for this target.
fn begin(folder: &Folder, target: &OsStr) -> io::Result<(OsString, File)> {
    for _ in 0..ATTEMPTS {
        let mut random = [0; DIGITS / 2];
        rand::rngs::SysRng.try_fill_bytes(&mut random).map_err(io::Error::other)?;
        let mut name = OsString::from(".");
        name.push(target);
        name.push(format!(".{:0DIGITS$x}{SUFFIX}", u64::from_le_bytes(random)));
        match folder.create_new(&name) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
            created => return Ok((name, created?)),
        }
    }
    Err(io::ErrorKind::AlreadyExists.into())
}

/// Gives a file the mode of the one that it replaces. File systems without modes have nothing to keep.
#[cfg(unix)]
fn keep_mode(old: &Metadata, new: &File) {
    use std::os::unix::fs::PermissionsExt;
    new.set_permissions(fs::Permissions::from_mode(old.permissions().mode() & 0o777)).ok();
}

#[cfg(not(unix))]
fn keep_mode(_old: &Metadata, _new: &File) {}

/// Age from which an unlocked partial file counts as abandoned: a new one is not yet locked.
const MIN_AGE: Duration = Duration::from_secs(2);

/// Removes partial files in a folder whose processes were killed: those for this target, or all of them.
/// Files that cannot be removed only take space.
pub(super) fn remove_abandoned(folder: &Path, target: Option<&OsStr>) {
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some(of) = name.to_str().and_then(target_of) else { continue };
        if target.is_some_and(|target| target != of) {
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
    let (target, random) = partial.strip_prefix('.')?.strip_suffix(SUFFIX)?.rsplit_once('.')?;
    let is_random = random.len() == DIGITS && random.bytes().all(|b| b.is_ascii_hexdigit());
    // Earlier versions wrote the number of the process.
    let is_number = !random.is_empty() && random.bytes().all(|b| b.is_ascii_digit());
    ((is_random || is_number) && !target.is_empty()).then_some(target)
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
    fn content_of_another_kind_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        let contents: [&[u8]; 7] = [
            b"PAR1\x15\x00\x15\x00",
            b"GIF89a\x01\x00",
            b"\x1f\x8b\x08\x00\x00\x00\x00\x00",
            b"<svg></svg>",
            b"{}",
            b"| a |\n",
            b"\x40\x00\x00\x00\x00\x00\x00\x00{}",
        ];
        for old in contents {
            for new in contents {
                fs::write(&path, old).unwrap();
                let replaced = replace(&path, |out| out.write_all(new));
                assert_eq!(replaced.is_ok(), old == new, "{old:?} by {new:?}: {replaced:?}");
                assert_eq!(fs::read(&path).unwrap(), old);
            }
            fs::write(&path, "").unwrap();
            replace(&path, |out| out.write_all(old)).unwrap();
            replace(&path, |_| Ok(())).unwrap();
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
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
        for name in [".rows.jsonl.0123456789abcdef.partial", ".rows.jsonl.12.partial"] {
            assert_eq!(target_of(name), Some("rows.jsonl"));
        }
        for other in [
            "rows.jsonl.12.partial",
            ".rows.partial",
            ".rows.x.partial",
            ".rows.beef.partial",
            ".12.partial",
            ".rows.12",
        ] {
            assert_eq!(target_of(other), None, "{other}");
        }
    }

    #[test]
    fn a_part_leaves_the_complete_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.b.parquet");
        fs::write(&path, "whole").unwrap();
        let mut file = NewFile::create(&path).unwrap();
        file.write_all(b"part").unwrap();
        let part = file.finish_part().unwrap();
        assert_eq!(part, folder.path().join("a.b.interrupted.parquet"));
        assert_eq!(
            (fs::read(&path).unwrap().as_slice(), fs::read(part).unwrap().as_slice()),
            (b"whole".as_slice(), b"part".as_slice())
        );
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 2);
        assert_eq!(interrupted(Path::new("x/a")), Path::new("x/a.interrupted"));
    }

    #[test]
    fn two_writers_of_one_file_do_not_meet() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let mut files = [NewFile::create(&path).unwrap(), NewFile::create(&path).unwrap()];
        for (file, text) in files.iter_mut().zip(["one", "two"]) {
            file.write_all(text.as_bytes()).unwrap();
        }
        for (file, text) in files.into_iter().zip(["one", "two"]) {
            file.finish().unwrap();
            assert_eq!(fs::read_to_string(&path).unwrap(), text);
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn a_folder_that_is_moved_away_keeps_its_file() {
        let home = tempfile::tempdir().unwrap();
        let [before, after] = ["before", "after"].map(|name| home.path().join(name));
        fs::create_dir(&before).unwrap();
        let file = NewFile::create(&before.join("a.txt")).unwrap();
        fs::rename(&before, &after).unwrap();
        fs::create_dir(&before).unwrap();
        file.finish().unwrap();
        assert!(after.join("a.txt").exists() && !before.join("a.txt").exists());
        assert_eq!(fs::read_dir(&after).unwrap().count(), 1);
    }

    #[test]
    #[cfg(unix)]
    fn the_mode_is_kept_and_links_are_followed() {
        use std::os::unix::fs::{PermissionsExt, symlink};
        let home = tempfile::tempdir().unwrap();
        let [file, link, nothing] = ["file", "link", "nothing"].map(|name| home.path().join(name));
        fs::create_dir(home.path().join("folder")).unwrap();
        fs::write(&file, "old").unwrap();
        fs::set_permissions(&file, fs::Permissions::from_mode(0o640)).unwrap();
        symlink("file", &link).unwrap();
        let writing = NewFile::create(&link).unwrap();
        let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode(&home.path().join(&writing.partial)), 0o640, "nobody else reads it meanwhile");
        drop(writing);
        replace(&link, |out| out.write_all(b"new")).unwrap();
        assert!(link.is_symlink());
        assert_eq!((fs::read_to_string(&file).unwrap().as_str(), mode(&file)), ("new", 0o640));
        symlink("folder/none", &nothing).unwrap();
        let error = NewFile::create(&nothing).unwrap_err().to_string();
        assert!(error.contains("a link to a file that does not exist"), "{error}");
        assert!(nothing.is_symlink() && !home.path().join("folder/none").exists());
    }
}
