//! Embedded files of pages; nothing is read from the disk.

/// A script of a page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// File name.
    pub name: &'static str,
    /// Content.
    pub text: &'static str,
}

macro_rules! shared {
    ($name:literal) => {
        Asset { name: $name, text: include_str!(concat!("assets/", $name)) }
    };
}

/// Scripts shared by all pages, each after its imports.
pub const SHARED: &[Asset] = &[
    shared!("camera.js"),
    shared!("palette.js"),
    shared!("decode.js"),
    shared!("geometry.js"),
    shared!("road.js"),
    shared!("bodies.js"),
    shared!("curves.js"),
];

/// Colours of all pages.
pub const PALETTE: &str = include_str!("assets/palette.css");
