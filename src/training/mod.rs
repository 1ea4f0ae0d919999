//! The learning loop: what is the same for every network that is trained here. Knows no particular one.
//!
//! Read [`Task`] and [`Source`] first, then [`Learner`]. What comes out depends on the settings, the data and the seed alone: not on
//! threads, on when checkpoints were written, or on whether the training was interrupted in between.
//!
//! - A batch is split into parts of a fixed size. Threads take parts; losses and gradients are added in the order of the parts. Every thread
//!   works on a copy of the network whose parameters are leaves of their own: burn puts graphs that share a leaf under one lock.
//! - A thread that finds no part any more prepares examples of the next batch, so that two batches are in memory at the most. Nothing that
//!   was prepared is kept: reading a scenario by number takes 6 to 13 ms in a debug build, a fraction of what learning from it does, and every
//!   look at it is varied anew.
//! - The order of the examples has no end: a batch may reach from one epoch into the next. The place of a step in it follows from its number,
//!   so that a checkpoint is parameters, moments and a few numbers.
//! - Checkpoints and weights are written under another name, synchronised and renamed; the last two checkpoints are kept. One that is damaged
//!   is refused by name, and the one before is never taken unasked.

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
