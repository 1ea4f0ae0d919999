//! The folder for inputs: one of this process, in memory.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// Beginning of the names of such folders; the number of the process follows.
const NAME: &str = "reactsim-fuzz-";

/// The folder of this process. Those of processes that have ended are removed.
pub fn folder() -> &'static Path {
    static FOLDER: OnceLock<PathBuf> = OnceLock::new();
    FOLDER.get_or_init(|| {
        let memory = Path::new("/dev/shm");
        let above = if memory.is_dir() { memory.to_owned() } else { std::env::temp_dir() };
        for entry in fs::read_dir(&above).into_iter().flatten().flatten() {
            let name = entry.file_name();
            let process = name.to_str().and_then(|n| n.strip_prefix(NAME));
            if process
                .is_some_and(|p| Path::new("/proc/self").exists() && !Path::new("/proc").join(p).exists())
            {
                // One that another process removes at the same time is gone as well.
                fs::remove_dir_all(entry.path()).ok();
            }
        }
        let folder = above.join(format!("{NAME}{}", std::process::id()));
        fs::create_dir_all(&folder).expect("a folder in memory");
        folder
    })
}

/// Writes a file of this name, with folders if it has some, and returns its path.
pub fn file(name: &str, content: &[u8]) -> PathBuf {
    let path = folder().join(name);
    if let Some(above) = path.parent() {
        fs::create_dir_all(above).expect("a folder in memory");
    }
    fs::write(&path, content).expect("a file in memory");
    path
}

/// Writes a map of nuPlan under a name that no map had before, since maps that were read are kept by name,
/// and the list that tells it.
pub fn map_of(content: &[u8]) -> PathBuf {
    static NEXT: AtomicU64 = AtomicU64::new(0);
    let next = NEXT.fetch_add(1, Ordering::Relaxed);
    if let Some(last) = next.checked_sub(1) {
        fs::remove_dir_all(folder().join(format!("maps/town/{last}"))).ok();
    }
    file("maps/nuplan-maps-v1.0.json", format!("{{\"town\": {{\"version\": \"{next}\"}}}}").as_bytes());
    file(&format!("maps/town/{next}/map.gpkg"), content)
}
