//! Paths that are URLs, and names of files without their folder.

use std::borrow::Cow;
use std::fs;
use std::io;
use std::path::Path;

/// Returns the URL that a path is: a scheme of at least two characters followed by `://`, such as
/// `s3://bucket/file`. `None` for the path of a file system.
pub fn as_url(path: &Path) -> Option<&str> {
    let text = path.to_str()?;
    let (scheme, _) = text.split_once("://")?;
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || "+-.".contains(c);
    let is_scheme = scheme.len() > 1 && scheme.starts_with(|c: char| c.is_ascii_alphabetic());
    (is_scheme && scheme.chars().all(is_allowed)).then_some(text)
}

/// Returns the name of a file without its folder. Query and fragment of a web address are no part of it.
pub fn name_of(path: &Path) -> Cow<'_, str> {
    if let Some(url) = as_url(path) {
        return Cow::Borrowed(location(url).trim_end_matches('/').rsplit('/').next().unwrap_or_default());
    }
    path.file_name().map_or_else(|| path.to_string_lossy(), |name| name.to_string_lossy())
}

/// Creates a folder and those above it.
///
/// # Errors
/// Those of the system, and for a URL, which would be a relative path with a folder `s3:`.
pub fn create_folder(path: &Path) -> io::Result<()> {
    refuse_url(path)?;
    fs::create_dir_all(path)
}

pub(super) fn refuse_url(path: &Path) -> io::Result<()> {
    match as_url(path) {
        None => Ok(()),
        Some(_) => {
            let text = "it is a URL; results are written to file systems: give a path";
            Err(io::Error::new(io::ErrorKind::InvalidInput, text))
        }
    }
}

/// Returns a URL without query and fragment, which only web addresses have: names of objects may contain
/// their marks.
pub(super) fn location(url: &str) -> &str {
    match url.starts_with("http://") || url.starts_with("https://") {
        true => url.split(['?', '#']).next().unwrap_or_default(),
        false => url,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn urls_are_told_from_paths() {
        for url in ["s3://a/b", "gs://a", "memory://x", "git+https://a"] {
            assert_eq!(as_url(Path::new(url)), Some(url));
        }
        for path in ["a/b", "/a://b", "C://a", "s3:/a/b", "a b://c", "://a", "", "1a://b"] {
            assert_eq!(as_url(Path::new(path)), None, "{path}");
        }
    }

    #[test]
    fn nothing_is_written_to_urls() {
        let path = Path::new("s3://bucket/folder");
        assert!(create_folder(path).unwrap_err().to_string().contains("it is a URL"));
        assert!(!Path::new("s3:").exists());
    }

    #[test]
    fn names_have_no_folder_and_no_query() {
        for (path, name) in [
            ("a/b.parquet", "b.parquet"),
            ("s3://bucket/a/b?c.parquet", "b?c.parquet"),
            ("https://host/a/b.parquet?key=c/d", "b.parquet"),
            ("https://host/a/b.parquet#c", "b.parquet"),
            ("gs://bucket/folder/", "folder"),
        ] {
            assert_eq!(name_of(Path::new(path)), name);
        }
    }
}
