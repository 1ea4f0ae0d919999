//! Common parts of the program's pages: the drawn content of a scenario ([`sketch()`]), the scripts that
//! draw it, and a server that only this machine can reach ([`Loopback`]). Independent of the purpose of a
//! page.

mod assets;
mod bundle;
mod guard;
mod server;

pub use assets::{Asset, PALETTE, SHARED};
pub use bundle::bundle;
pub use reactsim_formats::{SKETCH_VERSION, sketch};
pub use server::{Loopback, ServeError, Site, Stop};
