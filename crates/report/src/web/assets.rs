//! Embedded files of pages; nothing is read from the disk.

/// A file of a page.
#[derive(Clone, Copy, Debug)]
pub struct Asset {
    /// File name.
    pub name: &'static str,
    /// Media type.
    pub kind: &'static str,
    /// Content.
    pub text: &'static str,
}

/// Media type of scripts.
pub const JAVASCRIPT: &str = "text/javascript; charset=utf-8";

macro_rules! shared {
    ($name:literal) => {
        Asset { name: $name, kind: JAVASCRIPT, text: include_str!(concat!("assets/", $name)) }
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
pub const PALETTE: Asset =
    Asset { name: "palette.css", kind: "text/css; charset=utf-8", text: include_str!("assets/palette.css") };
