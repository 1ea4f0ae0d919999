//! Locks, by which one process at a time writes a folder.

use std::fs::{File, TryLockError};
use std::io;
use std::path::Path;
use std::thread::sleep;
use std::time::Duration;

/// Number of attempts at a lock.
const ATTEMPTS: u32 = 20;
/// Time between two attempts. A process that this one starts holds its open files, and with them their locks,
/// until it runs its own program: a lock that was just given up can be held for a moment.
const PAUSE: Duration = Duration::from_millis(25);

/// Opens and locks a file until it is dropped. `None` if another process holds the lock. On file systems
/// without locks the file remains unlocked.
///
/// # Errors
/// If the file cannot be opened.
pub fn lock(path: &Path) -> io::Result<Option<File>> {
    let file = File::open(path)?;
    for attempt in 0..ATTEMPTS {
        if attempt > 0 {
            sleep(PAUSE);
        }
        if !matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            return Ok(Some(file));
        }
    }
    Ok(None)
}

#[cfg(test)]
mod tests {
    use std::thread;

    use super::*;

    #[test]
    fn a_lock_is_held_until_it_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("file");
        std::fs::write(&path, "").unwrap();
        let held = lock(&path).unwrap().expect("nobody else holds it");
        assert!(lock(&path).unwrap().is_none());
        // A lock that is given up in time is acquired.
        let release = thread::spawn(move || {
            sleep(2 * PAUSE);
            drop(held);
        });
        assert!(lock(&path).unwrap().is_some());
        release.join().unwrap();
        assert!(lock(&folder.path().join("missing")).is_err());
    }
}
