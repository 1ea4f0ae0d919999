//! What the pages of this program share: what is drawn of a scenario ([`sketch()`]), the scripts that draw it, and a server that only this
//! machine reaches ([`Loopback`]). It must never know what a page is for.

mod assets;
mod bundle;
mod guard;
mod server;
mod sketch;

pub use assets::{Asset, JAVASCRIPT, PALETTE, SHARED};
pub use bundle::bundle;
pub use server::{Loopback, ServeError, Site, Stop};
pub use sketch::{SKETCH_VERSION, sketch};
