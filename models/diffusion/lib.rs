//! Diffusion: noise schedules, samplers with hooks for guidance, and motion that a network can be trained
//! through; and the models that use them: [`vbd`], [`ctg`] and [`planner`].
//!
//! A diffusion network is asked for the clean value x0 of a noisy one. What the value is (actions, states) is
//! the affair of the models that use this.

mod continued;
pub mod ctg;
mod guide;
mod inverse;
pub mod joint_plan;
mod motion;
mod normal;
pub mod planner;
mod sampler;
mod schedule;
mod solver;
#[cfg(test)]
mod tests;
mod unicycle;
pub mod vbd;
mod waves;

pub use continued::{continued, latest_motion};
pub use guide::{Guide, Moment};
pub use inverse::{Actions, actions};
pub use motion::{motion_from, normalized, own_motion, states_of, unnormalized};
pub use normal::{normal_values, standard_normal};
pub use sampler::{Sampler, Sampling};
pub use schedule::{Schedule, ScheduleError};
pub use solver::{VariancePreserving, solve};
pub use unicycle::roll_out;
