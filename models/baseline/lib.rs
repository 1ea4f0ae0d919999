//! Shared parts of the baselines of [reactsim](https://docs.rs/reactsim): [`Baseline`], the entry of a simulator
//! in the list of baselines, and the [`Setup`] from which it is built: the parameters of its card within
//! their ranges, and weights. [`non_reactive`] has the baselines that need nothing else.

mod backend;
mod card;
mod entry;
mod error;
pub mod non_reactive;
mod parameters;
mod ranges;
mod setup;
pub mod weights;

pub use backend::{Backend, BackendError};
pub use card::Card;
pub use entry::{Baseline, Make};
pub use error::ModelError;
pub use parameters::Parameters;
pub use ranges::{Allowed, ParameterRange, Ranges};
pub use setup::Setup;
pub use weights::WeightsFile;
