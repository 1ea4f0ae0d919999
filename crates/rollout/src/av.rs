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
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct AvError(pub String);

impl AvError {
    /// Returns the error of a trajectory without a state for each of the `expected` steps of the scenario.
    pub fn length(found: usize, expected: usize) -> Self {
        Self(format!(
            "the AV trajectory has {found} states, expected {expected} (steps 1 to {expected} at 10 Hz)"
        ))
    }

    /// Returns the error of a jump of `metres` to `step` (from 1), more than [`MAX_STEP_DISPLACEMENT`].
    pub fn jump(step: usize, metres: f64) -> Self {
        Self(format!(
            "the AV trajectory jumps {metres:.1} m between steps {} and {step}, \
             more than {MAX_STEP_DISPLACEMENT:.1} m in 0.1 s",
            step.saturating_sub(1)
        ))
    }

    /// Returns the error of a planner that does not drive the AV to `step` (from 1).
    pub fn planner(step: usize, reason: &str) -> Self {
        Self(format!("the planner does not drive the AV to step {step}: {reason}"))
    }

    fn absent(step: usize) -> Self {
        Self(format!(
            "the logged AV is absent at step {step}; choose an AV that needs no log, such as \
             `constant-velocity`, or an earlier current frame where the recording has one"
        ))
    }
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
            return Err(AvError::length(track.len(), expected));
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
            return Err(AvError(format!("the AV trajectory is not finite at step {}", i + 1)));
        }
        let metres = (state.position() - before.position()).norm();
        if metres > MAX_STEP_DISPLACEMENT {
            return Err(AvError::jump(i + 1, metres));
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
    /// [`AvError`] when the log does not hold the AV at every step.
    pub fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let states = (1..).zip(&scenario.log_future.tracks[0]);
        let track = states
            .map(|(step, state)| state.ok_or_else(|| AvError::absent(step)))
            .collect::<Result<_, _>>()?;
        Ok(Self { track })
    }
}

impl Av for LogAv {
    fn begin(&self, _: u32) -> Box<dyn AvPolicy + '_> {
        Box::new(FixedStates { track: &self.track, is_recording: true })
    }
}
