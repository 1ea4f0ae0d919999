//! Microscopic traffic on a generated map: individual drivers with their own parameters, car following with
//! reaction times and perception errors (Gipps), lane changes (MOBIL), gap acceptance, lights and signs.
//! Sources of models and parameters: `crates/generation/README.md`.

mod arrivals;
mod changing;
mod driver;
mod encounters;
pub mod fleet;
mod following;
mod free_road;
mod network;
mod occupancy;
pub mod parked;
pub mod people;
mod recording;
mod routes;
mod vehicle;
mod world;
mod yielding;

pub use driver::Manner;
pub use recording::{Recording, record};
