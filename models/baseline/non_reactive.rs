//! Baselines of [reactsim](https://docs.rs/reactsim) that do not react to the AV: log replay, constant velocity, and a
//! stop.

pub mod constant_velocity;
pub mod log_replay;
pub mod stop;
