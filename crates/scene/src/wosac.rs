//! The data of the Waymo Open Sim Agents Challenge (WOSAC): recorded scenarios with everything that the
//! realism metrics read, and the rollouts of a simulator.
//!
//! The [`Scenario`](super::Scenario) of this crate keeps what simulators need. The metrics of the challenge
//! read more: heights, states that are marked invalid, all objects, and lights whose stop points move. A
//! [`WosacLog`] has them as stored, in world coordinates.

mod check;
mod log;
mod rollouts;
mod scenario;

pub use check::{align, check_rollouts};
pub use log::{LaneSignal, SurfaceLane, WosacLog, WosacTrack};
pub use rollouts::{JointScene, ObjectTrajectory, ScenarioRollouts};
pub use scenario::ObjectIds;

/// Number of rollouts (joint scenes) per scenario that the challenge requires.
pub const CHALLENGE_ROLLOUTS: usize = 32;
