//! Files: written so that they are complete or absent, whatever happens; read only if they are regular files;
//! locked.

mod digest;
mod lock;
mod new_file;
mod regular;

pub use digest::{FileDigest, digest};
pub use lock::lock;
pub use new_file::{NewFile, replace, target_of};
pub use regular::{open_regular, read_regular};
