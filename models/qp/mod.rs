//! Plans of vehicles as quadratic programs: smooth, within the limits of the benchmark, on the road, and clear of others.
//!
//! A stage between a simulator's wishes and what vehicles do. Read [`Stage`] first; [`Smoothing`] puts it behind a simulator. Why the
//! programs are as they are, and figures: `models/qp/README.md`.

mod bends;
mod drive;
mod ending;
mod forecast;
mod mode;
mod obstacle;
mod program;
mod rows;
mod settings;
mod sides;
mod smoothed;
mod speed;
mod stage;
#[cfg(test)]
mod tests;
mod vehicle;
mod walkers;
mod way;

pub use ending::{Ending, Endings};
pub use mode::Mode;
pub use program::Solve;
pub use settings::Settings;
pub use smoothed::{CARD, REFUSED, Smoothing, settings};
pub use speed::STEPS;
pub use stage::{Intent, KeepClear, Stage, is_planned};
