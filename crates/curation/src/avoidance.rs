//! Certificates that conflicts can be avoided.
//!
//! For every agent that a candidate disturbs under log replay, a response along its own logged path is
//! computed: another speed profile or, failing that, also a small lateral shift. Agents behind a
//! responding one may have to respond as well.
//!
//! The steps: the agents in conflict and their reaction times (`cascade`); the parts of an agent's path
//! that are blocked, and when (`blocked`); the side on which to pass each blocked region, and the
//! smoothest profile there (`sides`, `smoothest`, `speed_caps`, `solver`); and finally the metrics
//! themselves on the whole scene (`check`).

mod blocked;
mod cascade;
mod check;
mod effort;
mod front;
mod own_path;
mod problem;
mod profile;
mod respond;
mod responder;
mod settings;
mod sides;
mod smoothest;
mod solver;
mod speed_caps;
mod traffic;
mod unavoidable;

pub use cascade::{certify, certify_case};
pub use settings::AvoidanceSettings;
pub use unavoidable::Unavoidable;
