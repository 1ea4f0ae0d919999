//! AVs: fixed trajectories, the logged AV, scripts, and AVs that a simulator moves.

mod logged_drive;
mod scripted;
mod simulated;

use super::Observation;
use reactsim_scene::{AgentState, Scenario, estimate_av_velocities};

pub use logged_drive::LoggedDrive;
pub use scripted::{ParseScriptError, Script, ScriptedAv};
pub use simulated::SimulatedAv;

/// The AV of a scenario. It does not change: rollouts share it, and each begins a policy with a state of its
/// own.
pub trait Av: Send + Sync {
    /// Creates the policy of one rollout. `rollout`: index among the rollouts of the scenario, part of the
    /// names of random streams.
    fn begin(&self, rollout: u32) -> Box<dyn AvPolicy + '_>;
}

/// Policy that moves the AV one step at a time during one rollout.
pub trait AvPolicy {
    /// Returns the AV's state at the next step; `seen` holds states up to now.
    ///
    /// # Errors
    /// [`AvError`] when there is no such state.
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError>;

    /// Returns the number of frames up to the current one that the policy was built for, as
    /// [`Simulator::history`](crate::Simulator::history). `None`: any number.
    fn history(&self) -> Option<usize> {
        None
    }

    /// Returns the number of steps after which the policy needs a new start, as
    /// [`Simulator::horizon`](crate::Simulator::horizon). `None`: never.
    fn horizon(&self) -> Option<usize> {
        None
    }

    /// Returns whether the states come from a recording, so that their velocities were measured. For all
    /// other policies velocities are replaced by position differences.
    fn replays_recording(&self) -> bool {
        false
    }
}

/// Policy that moves the AV along fixed states, one per step.
struct FixedStates<'a> {
    track: &'a [AgentState],
    is_recording: bool,
}

impl AvPolicy for FixedStates<'_> {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        Ok(self.track[seen.step()])
    }

    fn replays_recording(&self) -> bool {
        self.is_recording
    }
}

/// Reason why the AV cannot be moved.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum AvError {
    /// The logged AV is absent at a step.
    #[error(
        "the logged AV is absent at step {step}; choose an AV that needs no log, such as \
         `constant-velocity`, or an earlier current frame where the recording has one"
    )]
    Absent {
        /// Step, from 1.
        step: usize,
    },
    /// The number of states of a trajectory differs from the steps of the scenario.
    #[error("the AV trajectory has {found} states, expected {expected} (steps 1 to {expected} at 10 Hz)")]
    Length {
        /// States found.
        found: usize,
        /// Steps of the scenario.
        expected: usize,
    },
    /// A trajectory holds a value that is not finite.
    #[error("the AV trajectory is not finite at step {step}")]
    NotFinite {
        /// Step, from 1.
        step: usize,
    },
    /// A trajectory jumps.
    #[error(
        "the AV trajectory jumps {metres:.1} m between steps {before} and {step}, \
         more than {limit:.1} m in 0.1 s"
    )]
    Jump {
        /// Step, from 1.
        step: usize,
        /// The step before.
        before: usize,
        /// Length of the jump, metres.
        metres: f64,
        /// Largest plausible displacement in one step, metres.
        limit: f64,
    },
    /// A planner does not drive the AV to its next state.
    #[error("the planner does not drive the AV to step {step}: {reason}")]
    Planner {
        /// Step, from 1.
        step: usize,
        /// Reason.
        reason: String,
    },
    /// The simulator that moves the AV has no state for it.
    #[error("the simulator does not move the AV to step {step}: {reason}")]
    Simulator {
        /// Step, from 1.
        step: usize,
        /// Reason.
        reason: String,
    },
}

/// Largest plausible displacement of an AV in 0.1 s, metres: 80 m/s.
pub const MAX_STEP_DISPLACEMENT: f64 = 8.0;

/// AV that replays a fixed trajectory: the deviated AV of the benchmark.
#[derive(Clone, Debug)]
pub struct DeviatedAv {
    track: Vec<AgentState>,
}

impl DeviatedAv {
    /// Creates an AV of a scenario from a trajectory with a state for each of its steps. Unknown velocities
    /// become differences of positions.
    ///
    /// # Errors
    /// [`AvError`] when the trajectory has another number of states, holds values that are not finite, or
    /// jumps.
    pub fn new(scenario: &Scenario, mut track: Vec<AgentState>) -> Result<Self, AvError> {
        let (now, expected) = (scenario.start.now(0), scenario.length().future);
        if track.len() != expected {
            return Err(AvError::Length { found: track.len(), expected });
        }
        check_steps(&now, &track)?;
        estimate_av_velocities(&now, &mut track);
        Ok(Self { track })
    }
}

/// Rejects a trajectory that continues from `now` if a state is not finite or too far from the previous
/// one.
fn check_steps(now: &AgentState, track: &[AgentState]) -> Result<(), AvError> {
    let mut before = now;
    for (i, state) in track.iter().enumerate() {
        if !state.is_finite() {
            return Err(AvError::NotFinite { step: i + 1 });
        }
        let metres = (state.position() - before.position()).norm();
        if metres > MAX_STEP_DISPLACEMENT {
            return Err(AvError::Jump { step: i + 1, before: i, metres, limit: MAX_STEP_DISPLACEMENT });
        }
        before = state;
    }
    Ok(())
}

impl Av for DeviatedAv {
    fn begin(&self, _: u32) -> Box<dyn AvPolicy + '_> {
        Box::new(FixedStates { track: &self.track, is_recording: false })
    }
}

/// AV that replays its log.
#[derive(Clone, Debug)]
pub struct LogAv {
    track: Vec<AgentState>,
}

impl LogAv {
    /// Creates the logged AV of a scenario.
    ///
    /// # Errors
    /// [`AvError::Absent`] when the log does not hold the AV at every step.
    pub fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let states = (1..).zip(&scenario.log_future.tracks[0]);
        let track =
            states.map(|(step, state)| state.ok_or(AvError::Absent { step })).collect::<Result<_, _>>()?;
        Ok(Self { track })
    }
}

impl Av for LogAv {
    fn begin(&self, _: u32) -> Box<dyn AvPolicy + '_> {
        Box::new(FixedStates { track: &self.track, is_recording: true })
    }
}
