//! Opening of regular files, and of files behind URLs. Pipes and devices would block, or never end.

use std::fs::File;
use std::io::{self, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

#[cfg(feature = "cloud")]
use super::cloud;
use super::url::as_url;

/// A file that is open for reading.
pub enum InputFile {
    /// A file of a file system.
    Local(File),
    /// A file behind a URL.
    #[cfg(feature = "cloud")]
    Remote(Box<cloud::RemoteFile>),
}

impl InputFile {
    /// Returns the size in bytes.
    ///
    /// # Errors
    /// Those of the system.
    pub fn size(&self) -> io::Result<u64> {
        match self {
            Self::Local(file) => Ok(file.metadata()?.len()),
            #[cfg(feature = "cloud")]
            Self::Remote(file) => Ok(file.meta.size),
        }
    }
}

impl Read for InputFile {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        match self {
            Self::Local(file) => file.read(buffer),
            #[cfg(feature = "cloud")]
            Self::Remote(file) => file.read(buffer),
        }
    }

    fn read_to_end(&mut self, buffer: &mut Vec<u8>) -> io::Result<usize> {
        match self {
            Self::Local(file) => file.read_to_end(buffer),
            #[cfg(feature = "cloud")]
            Self::Remote(file) => file.read_to_end(buffer),
        }
    }
}

impl Seek for InputFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match self {
            Self::Local(file) => file.seek(to),
            #[cfg(feature = "cloud")]
            Self::Remote(file) => file.seek(to),
        }
    }
}

/// Opens a regular file, or a file behind a URL, for reading.
///
/// # Errors
/// Those of the system or of the store, [`io::ErrorKind::InvalidInput`] for a pipe, a device or a folder, and
/// [`io::ErrorKind::Unsupported`] for a URL without the feature `cloud`.
pub fn open_regular(path: &Path) -> io::Result<InputFile> {
    if let Some(url) = as_url(path) {
        #[cfg(feature = "cloud")]
        return Ok(InputFile::Remote(Box::new(cloud::open(url)?)));
        #[cfg(not(feature = "cloud"))]
        return Err(unread(url));
    }
    open_local(path).map(InputFile::Local)
}

/// Opens a regular file of a file system.
///
/// # Errors
/// As [`open_regular`], and for a URL.
pub fn open_local(path: &Path) -> io::Result<File> {
    if as_url(path).is_some() {
        let text = "it is a URL; copy the file to a file system first";
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    let metadata = path.metadata()?;
    if !metadata.is_file() {
        let what = if metadata.is_dir() { "a folder" } else { "a pipe or a device" };
        let text = format!("it is {what}, not a file; copy its content to a file first");
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    File::open(path)
}

/// Reads a regular file, or a file behind a URL.
///
/// # Errors
/// Same as [`open_regular`].
pub fn read_regular(path: &Path) -> io::Result<Vec<u8>> {
    let mut content = Vec::new();
    open_regular(path)?.read_to_end(&mut content)?;
    Ok(content)
}

/// Lists the file at a URL, or all files below it, in the order in which a folder is read.
///
/// # Errors
/// Those of the store, if nothing is there, and without the feature `cloud`.
pub fn list_url(url: &str) -> io::Result<Vec<PathBuf>> {
    #[cfg(feature = "cloud")]
    return cloud::list(url).map(|mut files| {
        files.sort();
        files
    });
    #[cfg(not(feature = "cloud"))]
    Err(unread(url))
}

#[cfg(not(feature = "cloud"))]
fn unread(url: &str) -> io::Error {
    let text = match url.split_once("://") {
        Some(("s3" | "s3a" | "gs" | "az" | "azure" | "abfs" | "abfss" | "http" | "https", _)) => {
            "it is a URL, which this program does not read: download the file first, or build the program \
             with `--features cloud`"
        }
        _ => "it is a URL, which this program does not read: download the file first",
    };
    io::Error::new(io::ErrorKind::Unsupported, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    #[cfg(not(feature = "cloud"))]
    fn urls_need_a_feature() {
        let opened = open_regular(Path::new("s3://bucket/file")).map(drop).unwrap_err();
        let listed = list_url("s3://bucket").unwrap_err();
        for error in [opened, listed] {
            assert_eq!(error.kind(), io::ErrorKind::Unsupported);
            let text = error.to_string();
            assert!(
                text.contains("`--features cloud`") && text.contains("download the file first"),
                "{text}"
            );
        }
        let other = list_url("hf://datasets/a/b").unwrap_err().to_string();
        assert!(other.contains("download the file first") && !other.contains("feature"), "{other}");
    }

    #[test]
    #[cfg(unix)]
    fn devices_and_folders_are_refused() {
        for (path, what) in [("/dev/zero", "a pipe or a device"), ("/", "a folder")] {
            let error = read_regular(Path::new(path)).unwrap_err().to_string();
            assert!(error.contains(what) && error.contains("copy its content"), "{error}");
        }
    }
}
