//! Files: written so that they are complete or absent, whatever happens; read if they are regular files or
//! behind URLs; locked. [`work`] has what else the program takes from its machine: threads.

#[cfg(feature = "cloud")]
mod cloud;
mod digest;
mod folder;
mod kind;
mod lock;
mod new_file;
mod regular;
mod url;
pub mod work;

pub use digest::{FileDigest, digest};
pub use lock::{FolderLock, LOCK, lock_folder};
pub use new_file::{NewFile, interrupted, replace, target_of};
pub use regular::{InputFile, list_url, open_local, open_regular, read_regular};
pub use url::{as_url, create_folder, name_of};
