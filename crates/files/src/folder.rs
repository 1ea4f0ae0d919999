//! A folder in which files are created, renamed and removed by name: the same folder to the end, also if its
//! path leads elsewhere meanwhile.

use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::path::Path;

pub(super) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

#[cfg(unix)]
#[derive(Debug)]
pub(super) struct Folder(std::os::fd::OwnedFd);

#[cfg(unix)]
impl Folder {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        use rustix::fs::{Mode, OFlags, open};
        // Only a name in it is needed: the folder need not be readable.
        #[cfg(any(target_os = "linux", target_os = "android"))]
        let access = OFlags::PATH;
        #[cfg(not(any(target_os = "linux", target_os = "android")))]
        let access = OFlags::RDONLY;
        Ok(Self(open(path, access | OFlags::DIRECTORY | OFlags::CLOEXEC, Mode::empty())?))
    }

    /// Creates a file for writing, and for reading what is written. A file or a link of this name is an
    /// error.
    pub(super) fn create_new(&self, name: &OsStr) -> io::Result<File> {
        use rustix::fs::OFlags;
        self.file(name, OFlags::RDWR | OFlags::CREATE | OFlags::EXCL)
    }

    /// Opens or creates a file for a lock. A link of this name is an error.
    pub(super) fn open_or_create(&self, name: &OsStr) -> io::Result<File> {
        use rustix::fs::OFlags;
        // Network file systems lock only files that are open for writing.
        self.file(name, OFlags::RDWR | OFlags::CREATE)
    }

    fn file(&self, name: &OsStr, flags: rustix::fs::OFlags) -> io::Result<File> {
        use rustix::fs::{Mode, OFlags, openat};
        let flags = flags | OFlags::CLOEXEC | OFlags::NOFOLLOW;
        Ok(openat(&self.0, name, flags, Mode::from_raw_mode(0o666))?.into())
    }

    /// Renames a file; one with the new name is replaced, and a link is not followed.
    pub(super) fn rename(&self, old: &OsStr, new: &OsStr) -> io::Result<()> {
        Ok(rustix::fs::renameat(&self.0, old, &self.0, new)?)
    }

    pub(super) fn remove(&self, name: &OsStr) -> io::Result<()> {
        Ok(rustix::fs::unlinkat(&self.0, name, rustix::fs::AtFlags::empty())?)
    }

    /// Returns whether an open file still has this name.
    pub(super) fn has(&self, name: &OsStr, file: &File) -> bool {
        use rustix::fs::{AtFlags, fstat, statat};
        match (statat(&self.0, name, AtFlags::SYMLINK_NOFOLLOW), fstat(file)) {
            (Ok(named), Ok(open)) => (named.st_dev, named.st_ino) == (open.st_dev, open.st_ino),
            _ => false,
        }
    }

    /// Writes the names of the files to the disk. Some systems cannot; the files are complete anyway.
    pub(super) fn sync(&self) {
        use rustix::fs::{Mode, OFlags, fsync, openat};
        let flags = OFlags::RDONLY | OFlags::DIRECTORY | OFlags::CLOEXEC;
        if let Ok(folder) = openat(&self.0, ".", flags, Mode::empty()) {
            fsync(folder).ok();
        }
    }
}

#[cfg(not(unix))]
#[derive(Debug)]
pub(super) struct Folder(std::path::PathBuf);

#[cfg(not(unix))]
impl Folder {
    pub(super) fn open(path: &Path) -> io::Result<Self> {
        path.read_dir()?;
        Ok(Self(path.to_owned()))
    }

    pub(super) fn create_new(&self, name: &OsStr) -> io::Result<File> {
        let mut options = std::fs::OpenOptions::new();
        options.read(true).write(true).create_new(true).open(self.0.join(name))
    }

    pub(super) fn open_or_create(&self, name: &OsStr) -> io::Result<File> {
        let mut options = std::fs::OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false).open(self.0.join(name))
    }

    pub(super) fn rename(&self, old: &OsStr, new: &OsStr) -> io::Result<()> {
        std::fs::rename(self.0.join(old), self.0.join(new))
    }

    pub(super) fn remove(&self, name: &OsStr) -> io::Result<()> {
        std::fs::remove_file(self.0.join(name))
    }

    pub(super) fn has(&self, _name: &OsStr, _file: &File) -> bool {
        true
    }

    pub(super) fn sync(&self) {}
}
