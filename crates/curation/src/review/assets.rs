//! The files of the page. They are part of the program; nothing is read from disk.

use reactsim_web::{Asset, JAVASCRIPT};

macro_rules! asset {
    ($name:literal, $kind:expr) => {
        Asset { name: $name, kind: $kind, text: include_str!(concat!("assets/", $name)) }
    };
}

/// The page itself; its address is the token alone.
pub(super) const PAGE: Asset = asset!("page.html", "text/html; charset=utf-8");

/// Files of the page in addition to those that all pages share.
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
