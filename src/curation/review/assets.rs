//! The files of the page. They are part of the program; nothing is read from the disk.

use crate::web::{Asset, JAVASCRIPT};

macro_rules! asset {
    ($name:literal, $kind:expr) => {
        Asset { name: $name, kind: $kind, text: include_str!(concat!("assets/", $name)) }
    };
}

/// The page itself; its address is the token alone.
pub(super) const PAGE: Asset = asset!("page.html", "text/html; charset=utf-8");

/// What the page loads, beside what all pages have.
pub(super) const ASSETS: &[Asset] = &[
    asset!("style.css", "text/css; charset=utf-8"),
    asset!("main.js", JAVASCRIPT),
    asset!("api.js", JAVASCRIPT),
    asset!("scenario.js", JAVASCRIPT),
    asset!("draw.js", JAVASCRIPT),
    asset!("charts.js", JAVASCRIPT),
    asset!("panel.js", JAVASCRIPT),
    asset!("queue.js", JAVASCRIPT),
    asset!("keys.js", JAVASCRIPT),
    asset!("notice.js", JAVASCRIPT),
];
