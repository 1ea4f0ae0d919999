//! Files that are complete or absent, whatever happens while they are written.

mod new_file;

pub use new_file::{NewFile, replace, target_of};
