//! The files of pages. They are part of the program; nothing is read from the disk.

/// A file of a page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// Its name.
    pub name: &'static str,
    /// Its media type.
    pub kind: &'static str,
    /// Its content.
    pub text: &'static str,
}

/// The media type of scripts.
pub const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! shared {
    ($name:literal) => {
        Asset { name: $name, kind: JAVASCRIPT, text: include_str!(concat!("assets/", $name)) }
    };
}

/// The scripts that every page has, each after those that it imports.
pub const SHARED: &[Asset] = &[
    shared!("camera.js"),
    shared!("palette.js"),
    shared!("decode.js"),
    shared!("geometry.js"),
    shared!("road.js"),
    shared!("bodies.js"),
    shared!("curves.js"),
];

/// The colours of all pages.
pub const PALETTE: Asset =
    Asset { name: "palette.css", kind: "text/css; charset=utf-8", text: include_str!("assets/palette.css") };
