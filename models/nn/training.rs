//! The training loop, common to all networks and independent of any particular one.
//!
//! Read [`Task`] and [`Source`] first, then [`Learner`]. The result depends only on the settings, the
//! data and the seed, not on the number of threads, the times of checkpoints or interruptions.
//!
//! - A batch is split into parts of a fixed size. Threads take parts; losses and gradients are added in
//!   the order of the parts. Every thread works on a copy of the network whose parameters are its own
//!   leaves: burn puts graphs that share a leaf under one lock.
//! - A thread that finds no further part prepares examples of the next batch, so that at most two
//!   batches are in memory. Prepared samples are not kept: reading a scenario by number takes 6 to 13 ms
//!   in a debug build, a fraction of the time of learning from it, and each use is augmented anew.
//! - The order of the examples is endless: a batch may span two epochs. The position of a step follows
//!   from its number, so that a checkpoint holds only parameters, moments and a few numbers.
//! - Checkpoints and weights are written under another name, synchronised and renamed; the last two
//!   checkpoints are kept. A damaged checkpoint is refused by name; the program never falls back to the
//!   previous one by itself.

mod adamw;
mod averages;
mod checkpoint;
mod error;
mod folder;
mod gradients;
mod hash;
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

pub use averages::{Average, Observation};
pub use checkpoint::Best;
pub use error::TrainingError;
pub use folder::{ABOUT, LOG, WEIGHTS, kept_weights};
pub use hash::{leading_bits, unit_interval};
pub use initial::draw_parameters;
pub use learner::{ClosedLoop, Ending, Learner, Observer, Outcome};
pub use log::{Row, StepRow, ValidationRow, Wall, read_log};
pub use parameters::parameter_paths;
pub use settings::{Execution, LOSS, Settings};
pub use stream::Stream;
pub use sums::Sums;
pub use task::{Output, Source, Task};
pub use tensors::{NamedTensor, NamedTensors};
