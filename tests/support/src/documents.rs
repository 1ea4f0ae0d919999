//! Documents of this repository.

use std::fs;
use std::path::{Path, PathBuf};

/// Root of the repository.
pub const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Folders with documents, and folders that are passed over in them.
const FOLDERS: [&str; 7] = ["crates", "docs", "fuzz", "models", "python", "scenarios", "src"];
const PASSED_OVER: [&str; 3] = ["target", "node_modules", "__pycache__"];

/// Returns all documents of the repository, in order.
pub fn all() -> Vec<PathBuf> {
    let root = Path::new(ROOT);
    let mut found: Vec<PathBuf> =
        ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"].map(|name| root.join(name)).into();
    for folder in FOLDERS {
        below(&root.join(folder), &mut found);
    }
    found.sort();
    found
}

/// Adds all Markdown files below a folder.
fn below(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if path.is_dir() && !PASSED_OVER.contains(&name) && !name.starts_with('.') {
            below(&path, found);
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}
