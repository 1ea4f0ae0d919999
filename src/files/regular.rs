//! Opening of regular files. Pipes and devices would block, or never end.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Opens a regular file for reading.
///
/// # Errors
/// Those of the system, and [`io::ErrorKind::InvalidInput`] for a pipe, a device or a folder.
pub fn open_regular(path: &Path) -> io::Result<File> {
    let metadata = path.metadata()?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
        let text = format!("it is {what}, not a file; copy its content to a file first");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    File::open(path)
}

/// Reads a regular file.
///
/// # Errors
/// Same as [`open_regular`].
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    open_regular(path)?.read_to_end(&mut content)?;
    Ok(content)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(unix)]
    fn devices_and_folders_are_refused() {
        for (path, what) in [("/dev/zero", "a pipe or a device"), ("/", "a folder")] {
            let error = read_regular(Path::new(path)).unwrap_err().to_string();
            assert!(error.contains(what) && error.contains("copy its content"), "{error}");
        }
    }
}
