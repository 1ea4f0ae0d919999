//! The learning loop: what is the same for every network that is trained here. Knows no particular one.
//!
//! Read [`Task`] and [`Source`] first, then [`Learner`]. What comes out depends on the settings, the data and the seed alone: not on
//! threads, on when checkpoints were written, or on whether the training was interrupted in between.

mod adamw;
mod checkpoint;
mod error;
mod folder;
mod gradients;
mod initial;
mod learner;
mod log;
mod order;
mod parameters;
mod schedule;
mod settings;
mod stream;
mod sums;
mod task;
mod tensors;

pub use checkpoint::Best;
pub use error::TrainingError;
pub use folder::{ABOUT, LOG, WEIGHTS};
pub use initial::draw_parameters;
pub use learner::{ClosedLoop, Ending, Learner, Observer, Outcome};
pub use log::{Row, StepRow, ValidationRow, Wall, read_log};
pub use settings::{Execution, Settings};
pub use stream::Stream;
pub use sums::Sums;
pub use task::{Output, Source, Task, View};
pub use tensors::{NamedTensor, NamedTensors};
