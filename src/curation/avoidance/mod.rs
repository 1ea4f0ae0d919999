//! Can the conflict be avoided? For every agent that the candidate disturbs under log replay a response along its own logged path is
//! looked for: another speed profile, else a small shift aside too. Those behind an agent that responds may have to respond likewise.
//!
//! The steps: who conflicts, and from when on it can react (`cascade`); what blocks an agent's path, and when (`blocked`); on which
//! side of each blob to pass, and the smoothest profile there (`sides`, `smoothest`, `pace`, `solver`); and in the end
//! the metrics themselves, on the whole scene (`check`).

mod blocked;
mod cascade;
mod check;
mod driver;
mod effort;
mod front;
mod own_path;
mod pace;
mod profile;
mod respond;
mod settings;
mod sides;
mod smoothest;
mod solver;
mod traffic;
mod unavoidable;

pub use cascade::{certify, certify_case};
pub use settings::AvoidanceSettings;
pub use unavoidable::Unavoidable;
