//! Scripted AVs, which work with any log.
//!
//! A script is planned once, from the log: a smooth path of bounded curvature that starts at the AV's
//! current pose ([`LoggedDrive::path`]), and a speed for every step ([`speeds`]). Both obey the
//! kinematic limits of the metrics at every transition, including the first one. A stationary AV repeats
//! exactly the same state in every frame.

use std::fmt;
use std::str::FromStr;

use reactsim_geometry::{direction, smooth_step};
use reactsim_scene::dynamics::{STANDSTILL_SPEED, follow, speeds};
use reactsim_scene::{AgentState, DT, Scenario, brief};

use super::logged_drive::{LoggedDrive, velocity_now};
use super::{Av, AvError, AvPolicy, FixedStates};

/// Behaviour of a scripted AV.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Script {
    /// Keeps its current speed, straight along its heading. Needs no logged future.
    ConstantVelocity,
    /// Brakes to a halt along the logged path, at this mean deceleration (m/s², more than 0, at most 6).
    Brake(f64),
    /// Drives the logged path at another speed (factor, more than 0, at most 3). The factor is reached
    /// by a smooth ramp, since the speed cannot jump; beyond the end of the path the AV follows its
    /// lane, or goes straight on if it is on none.
    Retime(f64),
    /// Shifts the logged path sideways (metres, left positive, at most 5) over 3 s, at the logged
    /// speeds. A slow AV needs the distance that its steering allows: about 6 m for 1 m, 14 m for 5 m. A
    /// stationary AV does not shift.
    Shift(f64),
}

/// Error for a text that is not a script.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseScriptError {
    /// Unknown script name.
    #[error(
        "`{0}` is not a scripted AV: expected `constant-velocity`, `brake:<m/s²>`, `retime:<factor>` \
         or `shift:<m>`, such as `brake:4`"
    )]
    Unknown(String),
    /// The value is missing, not a number, or out of range.
    #[error("`{text}` is not a scripted AV: expected `{name}:` and {range}, such as `{name}:{example}`")]
    Value {
        /// The text as typed.
        text: String,
        /// The script.
        name: &'static str,
        /// The accepted values.
        range: &'static str,
        /// An accepted value.
        example: &'static str,
    },
}

impl FromStr for Script {
    type Err = ParseScriptError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, value) = text.trim().split_once(':').unwrap_or((text.trim(), ""));
        let number = value.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let refuse = |name, range, example| {
            let text = text.replace(value, &brief(value));
            ParseScriptError::Value { text, name, range, example }
        };
        match name {
            "constant-velocity" if value.is_empty() => Ok(Self::ConstantVelocity),
            "brake" => number
                .filter(|v| 0.0 < *v && *v <= MAX_BRAKE_DECELERATION)
                .map(Self::Brake)
                .ok_or_else(|| refuse("brake", "a deceleration above 0 and at most 6 m/s²", "4")),
            "retime" => number
                .filter(|v| 0.0 < *v && *v <= 3.0)
                .map(Self::Retime)
                .ok_or_else(|| refuse("retime", "a factor above 0 and at most 3", "1.6")),
            "shift" => number
                .filter(|v| v.abs() <= 5.0)
                .map(Self::Shift)
                .ok_or_else(|| refuse("shift", "an offset from -5 to 5 m, left positive", "2")),
            _ => Err(ParseScriptError::Unknown(brief(text).into())),
        }
    }
}

impl fmt::Display for Script {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::ConstantVelocity => f.write_str("constant-velocity"),
            Self::Brake(v) => write!(f, "brake:{v}"),
            Self::Retime(v) => write!(f, "retime:{v}"),
            Self::Shift(v) => write!(f, "shift:{v}"),
        }
    }
}

/// Duration of a sideways shift, s.
const SHIFT_DURATION: f64 = 3.0;
/// Largest accepted deceleration, m/s²: the bound of the acceleration metric.
const MAX_BRAKE_DECELERATION: f64 = 6.0;

/// AV that follows a script.
#[derive(Clone, Debug)]
pub struct ScriptedAv {
    track: Vec<AgentState>,
}

impl ScriptedAv {
    /// Plans the script for a scenario: a state for each of its steps, within the kinematic limits.
    ///
    /// # Errors
    /// [`AvError`] when the script follows the log and the logged AV is absent at a step, or jumps.
    pub fn new(scenario: &Scenario, script: Script) -> Result<Self, AvError> {
        let (now, steps) = (scenario.start.now(0), scenario.length().future);
        let track = if script == Script::ConstantVelocity {
            straight_on(now, velocity_now(scenario), steps)
        } else {
            let log = LoggedDrive::new(scenario)?;
            let desired = match script {
                Script::Brake(deceleration) => speeds::brake(log.speeds()[0], deceleration, steps),
                Script::Retime(factor) => speeds::retime(log.speeds(), factor, steps),
                Script::Shift(_) | Script::ConstantVelocity => speeds::retime(log.speeds(), 1.0, steps),
            };
            let travel = desired.iter().sum::<f64>() * DT;
            let offset = if let Script::Shift(offset) = script { offset } else { 0.0 };
            // Short enough to be complete after 3 s, but no shorter than the steering allows: a
            // fifth-order ramp of length d and height h has a curvature of up to 5.8 h / d².
            let early: f64 = log.speeds().iter().take((SHIFT_DURATION / DT) as usize).sum();
            let length = (early * DT).max((5.8 * offset.abs() / 0.15).sqrt());
            let aside = |s: f64| offset * smooth_step(s / length);
            let path = log.path(scenario, (offset != 0.0).then_some(&aside), None, travel);
            follow(now, log.speeds()[0], &path, &desired)
        };
        Ok(Self { track })
    }

    /// Returns the planned states, one per step.
    pub fn track(&self) -> &[AgentState] {
        &self.track
    }
}

impl Av for ScriptedAv {
    fn begin(&self, _: u32) -> Box<dyn AvPolicy + '_> {
        Box::new(FixedStates { track: &self.track, is_recording: false })
    }
}

/// Returns a trajectory at the current speed, straight along the heading.
fn straight_on(now: AgentState, speed: f64, steps: usize) -> Vec<AgentState> {
    let speed = if speed.abs() < STANDSTILL_SPEED { 0.0 } else { speed };
    let velocity = direction(now.heading) * speed;
    let state = |step: usize| {
        let p = now.position() + velocity * (step as f64 * DT);
        AgentState { x: p.x, y: p.y, vx: velocity.x, vy: velocity.y, ..now }
    };
    (1..=steps).map(state).collect()
}

#[cfg(test)]
mod tests;
