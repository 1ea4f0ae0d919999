//! Locks, by which one process at a time writes a folder.

use std::ffi::OsStr;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::Duration;

use super::folder::Folder;
use super::new_file::remove_abandoned;

/// Name of the file that a process locks while it writes a folder. It is never replaced, and removed only by
/// the process that holds the lock.
pub const LOCK: &str = ".lock";
/// Number of attempts at a lock.
const ATTEMPTS: u32 = 20;
/// Time between two attempts. A process that this one starts holds its open files, and with them their locks,
/// until it runs its own program: a lock that was just given up can be held for a moment.
const PAUSE: Duration = Duration::from_millis(25);

/// The lock of a folder, until it is dropped. Partial files that killed processes have left in the folder are
/// removed when it is taken and when it is dropped.
#[derive(Debug)]
pub struct FolderLock {
    path: PathBuf,
    folder: Folder,
    _file: File,
}

/// Locks a folder, so that no other process writes there. Take the lock before anything in the folder is
/// changed, and look only then what is there. `None` if another process holds it. On file systems without
/// locks the folder remains unlocked.
///
/// # Errors
/// If the folder is missing, or no file can be created in it.
pub fn lock_folder(path: &Path) -> io::Result<Option<FolderLock>> {
    let folder = Folder::open(path)?;
    for attempt in 0..ATTEMPTS {
        if attempt > 0 {
            sleep(PAUSE);
        }
        let file = folder.open_or_create(OsStr::new(LOCK))?;
        let is_held = matches!(file.try_lock(), Err(TryLockError::WouldBlock));
        // The holder before may have removed the file meanwhile: its lock would exclude nobody.
        if !is_held && folder.has(OsStr::new(LOCK), &file) {
            remove_abandoned(path, None);
            return Ok(Some(FolderLock { path: path.to_owned(), folder, _file: file }));
        }
    }
    Ok(None)
}

impl Drop for FolderLock {
    fn drop(&mut self) {
        remove_abandoned(&self.path, None);
        // While the lock is held: whoever has opened the file before finds that it has no name any more.
        // Where that cannot be found out, the file stays.
        if cfg!(unix) {
            self.folder.remove(OsStr::new(LOCK)).ok();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicU32, Ordering};
    use std::thread;

    use super::*;

    #[test]
    fn a_lock_is_held_until_it_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let held = lock_folder(path).unwrap().expect("nobody else holds it");
        assert!(lock_folder(path).unwrap().is_none());
        // A lock that is given up in time is acquired.
        let release = thread::spawn(move || {
            sleep(2 * PAUSE);
            drop(held);
        });
        let held = lock_folder(path).unwrap();
        assert!(held.is_some());
        release.join().unwrap();
        drop(held);
        assert_eq!(path.read_dir().unwrap().count(), 0);
        assert!(lock_folder(&path.join("missing")).is_err());
    }

    #[test]
    fn a_lock_excludes_all_others_while_files_of_locks_come_and_go() {
        let folder = tempfile::tempdir().unwrap();
        let (inside, acquired) = (AtomicU32::new(0), AtomicU32::new(0));
        thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| {
                    for _ in 0..50 {
                        let Some(lock) = lock_folder(folder.path()).unwrap() else { continue };
                        assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                        acquired.fetch_add(1, Ordering::SeqCst);
                        thread::yield_now();
                        inside.fetch_sub(1, Ordering::SeqCst);
                        drop(lock);
                    }
                });
            }
        });
        assert!(acquired.into_inner() >= 50);
    }

    #[test]
    fn partial_files_of_killed_processes_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let [first, second] =
            [".a.1.partial", ".b.txt.0123456789abcdef.partial"].map(|n| folder.path().join(n));
        let abandon = |path: &Path| {
            let file = File::create(path).unwrap();
            file.set_modified(std::time::SystemTime::now() - Duration::from_secs(60)).unwrap();
        };
        abandon(&first);
        let lock = lock_folder(folder.path()).unwrap();
        assert!(!first.exists());
        // One that was too new when the lock was taken.
        abandon(&second);
        drop(lock);
        assert_eq!(folder.path().read_dir().unwrap().count(), 0);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_in_place_of_the_lock_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let target = folder.path().join("target");
        std::os::unix::fs::symlink(&target, folder.path().join(LOCK)).unwrap();
        assert!(lock_folder(folder.path()).is_err());
        assert!(!target.exists());
    }
}
