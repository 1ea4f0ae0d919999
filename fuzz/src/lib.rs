//! What the fuzz targets share: the readers of the main package, compiled without its other rooms, and what is asked of them.
//!
//! `README.md` tells how targets are run.

// The rooms under test are those of the main package, as a whole, not only what is asked here.
#![allow(dead_code)]

#[path = "../../src/geometry/mod.rs"]
pub mod geometry;
#[path = "../../src/scene/mod.rs"]
pub mod scene;

#[path = "../../src/formats/mod.rs"]
pub mod formats;

pub mod edits;
pub mod made;

mod ask;
mod folder;

pub use ask::ask;
pub use folder::{file, folder, map_of};
