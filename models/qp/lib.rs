//! Vehicle plans by quadratic programs: smooth, within the limits of the benchmark, on the road, and
//! clear of other agents.
//!
//! The stage sits between the modes that a simulator proposes and the motion of the vehicles. Read [`Stage`]
//! first; [`Smoothing`] puts it behind a simulator. [`regression`] has networks whose predictions it smooths.
//! `models/qp/README.md` explains the design and has figures.

mod av_routes;
mod bends;
mod drive;
mod ending;
mod forecast;
mod guard;
mod mode;
mod obstacle;
mod path;
mod planned_vehicle;
mod program;
pub mod regression;
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

pub use ending::{Ending, Endings, FAILED_SOLVES};
pub use guard::GuardSettings;
pub use mode::Mode;
pub use program::Solve;
pub use settings::Settings;
pub use smoothed::{CARD, RANGES, REFUSED, Smoothing, guarded, settings};
pub use speed::STEPS;
pub use stage::{Intent, KeepClear, Stage, is_planned};
