//! Simulators and planners that are programs of their own: a process protocol over standard input and output.
//!
//! The protocol is described in `docs/external-protocol.md`. Start with [`ExternalSimulator`]: a
//! [`Simulator`](reactsim_rollout::Simulator) whose plans come from child processes; an [`ExternalPlanner`]
//! plans trajectories of the AV. A `document` is the content of a frame; `scenes` and `realised` write what a
//! child receives, `replies` checks what it answers. A `pipe` carries frames, a `connection` limits their
//! time, a `process` is a child with its standard error, and `workers` hands out connections to threads.
//!
//! This module starts processes and reads clocks; models may do neither.

mod batch;
mod connection;
mod document;
mod error;
mod length;
mod pipe;
mod planner;
mod process;
mod processes;
mod realised;
mod replies;
mod scene_frame;
mod scenes;
mod settings;
mod simulator;
mod stderr;
mod workers;

pub use document::{DocumentError, Frame, FrameWriter, Values, read_frame};
pub use error::ExternalError;
pub use pipe::Parent;
pub use planner::{EgoMotion, EpisodeNames, ExternalPlanner, PlannerEpisode};
pub use process::{end_all, interrupt};
pub use processes::Processes;
pub use replies::{Description, PlannedPoses, Role};
pub use scene_frame::{SceneExtras, scene_frame};
pub use settings::{Command, ExternalSettings, RunOutline, STDIO, TimeLimits};
pub use simulator::{BatchDifference, ExternalSimulator};
pub use stderr::StderrTarget;

/// Version of the protocol.
pub const PROTOCOL: &str = "1";
