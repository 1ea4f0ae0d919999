//! Files behind URLs. What reads them is chosen by the program, since most programs read file systems only.

use std::io::{self, ErrorKind, Read, Seek};
use std::sync::OnceLock;

/// Reads files behind URLs.
pub trait Store: Sync {
    /// Opens the file at a URL.
    ///
    /// # Errors
    /// If there is no such file, or it cannot be read.
    fn open(&'static self, url: &str) -> io::Result<Box<dyn RemoteFile>>;

    /// Returns the URL of the file at a URL, or the URLs of all files below it, in any order.
    ///
    /// # Errors
    /// If nothing is there, or it cannot be read.
    fn list(&self, url: &str) -> io::Result<Vec<String>>;
}

/// An open file behind a URL.
pub trait RemoteFile: Read + Seek + Send {
    /// Returns the size in bytes.
    fn size(&self) -> u64;
}

static STORE: OnceLock<&dyn Store> = OnceLock::new();

/// Makes this program read URLs through a store. The first store stays.
pub fn set_store(store: &'static dyn Store) {
    STORE.get_or_init(|| store);
}

/// Returns the store of this program.
///
/// # Errors
/// If none was set.
pub(super) fn store() -> io::Result<&'static dyn Store> {
    STORE.get().copied().ok_or_else(|| {
        let text = "it is a URL, which this program does not read: copy it to a file system, or build the program \
                    with the feature `store` of reactsim and call `reactsim::store::install`";
        io::Error::new(ErrorKind::Unsupported, text)
    })
}
