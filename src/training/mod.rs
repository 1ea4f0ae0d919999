//! The learning loop: what is the same for every network that is trained here. Knows no particular one.
//!
//! Read [`Task`] and [`Source`] first, then [`Learner`]. What comes out depends on the settings, the data and the seed alone: not on
//! threads, on when checkpoints were written, or on whether the training was interrupted in between.

mod adamw;
mod error;
mod gradients;
mod initial;
mod learner;
mod order;
mod parameters;
mod schedule;
mod settings;
mod stream;
mod sums;
mod task;

pub use error::TrainingError;
pub use initial::draw_parameters;
pub use learner::{Learner, Outcome};
pub use settings::{Execution, Settings};
pub use stream::Stream;
pub use sums::{Sum, Sums};
pub use task::{Output, Source, Task, View};
