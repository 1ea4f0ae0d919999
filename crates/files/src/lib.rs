//! Files: written so that they are complete or absent, whatever happens; read if they are regular files or
//! behind URLs; locked.

mod digest;
mod folder;
mod kind;
mod lock;
mod new_file;
mod regular;
mod store;
mod url;

pub use digest::{FileDigest, digest};
pub use lock::{FolderLock, LOCK, lock_folder};
pub use new_file::{NewFile, interrupted, replace, target_of};
pub use regular::{InputFile, list_url, open_local, open_regular, read_regular};
pub use store::{RemoteFile, Store, set_store};
pub use url::{as_url, create_folder, name_of};
