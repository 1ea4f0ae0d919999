//! The baselines. Each is a folder: its simulator, its card, its line in [`MODELS`].

mod card;
pub mod constant_velocity;
pub mod idm;
pub mod log_replay;
pub mod nn;
pub mod ntp;
pub mod stop;

pub use card::{Card, CardError};

use reactsim::rollout::Controller;

/// A baseline: what `--models` and the tables name.
#[derive(Clone, Copy, Debug)]
pub struct Baseline {
    /// Stable id, such as `idm`.
    pub id: &'static str,
    /// The text of its card (TOML): what it is, its parameters and their sources.
    pub card: &'static str,
    /// Whether it is shown the log's future (†).
    pub oracle: bool,
    /// Makes its simulator.
    pub make: fn() -> Result<Controller, CardError>,
}

/// All baselines, in the order of the tables.
pub const MODELS: &[Baseline] = &[log_replay::ENTRY, constant_velocity::ENTRY, stop::ENTRY, idm::ENTRY];

/// The baseline with this id.
pub fn find(id: &str) -> Option<&'static Baseline> {
    MODELS.iter().find(|m| m.id == id)
}
