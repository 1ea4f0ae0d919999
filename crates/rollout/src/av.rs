//! AV policies: fixed trajectories, the logged AV, and scripts.

mod logged_drive;
mod scripted;

use super::Observation;
use reactsim_scene::{AgentState, CURRENT, FUTURE, Frame, Scenario};

pub use logged_drive::LoggedDrive;
pub use scripted::{ParseScriptError, Script, ScriptedAv};

/// Policy that moves the AV one step at a time.
pub trait AvPolicy: Send {
    /// Returns the AV's state at the next step; `seen` holds states up to now.
    ///
    /// # Errors
    /// [`AvError`] when there is no such state.
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError>;

    /// Returns a copy for another rollout. The original must not have been asked for a state yet.
    fn copy(&self) -> Box<dyn AvPolicy>;

    /// Returns whether the states come from a recording, so that their velocities were measured. For all
    /// other policies velocities are replaced by position differences.
    fn replays_recording(&self) -> bool {
        false
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
        /// Step 1 to 80.
        step: usize,
    },
    /// The number of states of a trajectory differs from the 80 steps.
    #[error("the AV trajectory has {found} states, expected 80 (steps 1 to 80 at 10 Hz)")]
    Length {
        /// States found.
        found: usize,
    },
    /// A trajectory holds a value that is not finite.
    #[error("the AV trajectory is not finite at step {step}")]
    NotFinite {
        /// Step 1 to 80.
        step: usize,
    },
    /// A trajectory jumps.
    #[error(
        "the AV trajectory jumps {metres:.1} m between steps {before} and {step}, \
         more than {limit:.1} m in 0.1 s"
    )]
    Jump {
        /// Step 1 to 80.
        step: usize,
        /// The step before.
        before: usize,
        /// Length of the jump, metres.
        metres: f64,
        /// Largest plausible displacement in one step, metres.
        limit: f64,
    },
}

/// Largest plausible displacement of an AV in 0.1 s, metres: 80 m/s.
const MAX_STEP_DISPLACEMENT: f64 = 8.0;

/// AV that replays a fixed trajectory: the deviated AV of the benchmark.
#[derive(Clone, Debug)]
pub struct DeviatedAv {
    track: Vec<AgentState>,
}

impl DeviatedAv {
    /// Creates an AV from a trajectory of 80 states that continues from the AV's current state.
    ///
    /// # Errors
    /// [`AvError`] when the trajectory does not have 80 states, holds values that are not finite, or
    /// jumps.
    pub fn new(now: &AgentState, track: Vec<AgentState>) -> Result<Self, AvError> {
        if track.len() != FUTURE {
            return Err(AvError::Length { found: track.len() });
        }
        check_steps(now, &track)?;
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

impl AvPolicy for DeviatedAv {
    fn copy(&self) -> Box<dyn AvPolicy> {
        Box::new(self.clone())
    }

    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        Ok(self.track[seen.frame() - CURRENT])
    }
}

/// AV that replays its log.
#[derive(Clone, Debug)]
pub struct LogAv {
    track: Vec<Frame>,
}

impl LogAv {
    /// Creates the logged AV of a scenario.
    ///
    /// # Errors
    /// [`AvError::Absent`] when the log does not hold the AV at every step.
    pub fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let track = scenario.log_future.tracks[0].clone();
        match track.iter().position(Option::is_none) {
            Some(i) => Err(AvError::Absent { step: i + 1 }),
            None => Ok(Self { track }),
        }
    }
}

impl AvPolicy for LogAv {
    fn copy(&self) -> Box<dyn AvPolicy> {
        Box::new(self.clone())
    }

    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        let step = seen.frame() - CURRENT;
        self.track[step].ok_or(AvError::Absent { step: step + 1 })
    }

    fn replays_recording(&self) -> bool {
        true
    }
}
