//! Shared parts of the fuzz targets: the readers of the main package, and the checks of their results.
//!
//! `README.md` tells how targets are run.

pub use reactsim::{formats, geometry, scene};

pub mod edits;
pub mod made;

mod ask;
mod folder;

pub use ask::ask;
pub use folder::{file, folder, map_of};
