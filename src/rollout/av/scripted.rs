//! Scripted AVs, with which any log can be run.
//!
//! A script is planned once, from the log: a smooth path of bounded curvature that starts at the AV's current pose
//! ([`path`]), and a speed for every step ([`speed`]). Both obey the kinematic limits of the metrics at every transition,
//! the first one included. An AV that stands does so exactly: the same numbers, frame after frame.

mod path;
mod speed;

use std::fmt;
use std::str::FromStr;

use self::path::Path;
use super::{AvError, AvPolicy, LONGEST_STEP, check_steps};
use crate::geometry::{direction, wrap};
use crate::rollout::Observation;
use crate::scene::{AgentState, CURRENT, DT, FUTURE, Frame, Scenario};

/// What a scripted AV does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Script {
    /// Keeps its current speed, straight along its heading. Needs no logged future.
    ConstantVelocity,
    /// Brakes to a halt along the logged path, at this mean deceleration (m/s², more than 0, at most 6).
    Brake(f64),
    /// Drives the logged path at another speed (factor, more than 0, at most 3). The factor is reached by a smooth ramp, since
    /// the speed can not jump; beyond the end of the path the AV follows its lane, or goes straight on where it is on none.
    Retime(f64),
    /// Moves the logged path sideways (metres, left positive, at most 5) over 3 s, at the logged speeds. A slow AV needs the
    /// way that its steering allows: about 6 m for 1 m, 14 m for 5 m. One that stands does not shift.
    Shift(f64),
}

/// Why a text is no script.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ParseScriptError {
    /// Not one of the names.
    #[error(
        "`{0}` is no scripted AV: expected `constant-velocity`, `brake:<m/s²>`, `retime:<factor>` or `shift:<m>`, such as `brake:4`"
    )]
    Unknown(String),
    /// The value is missing, no number, or out of range.
    #[error("`{text}` is no scripted AV: expected `{name}:` and {range}, such as `{name}:{example}`")]
    Value {
        /// What was typed.
        text: String,
        /// The script.
        name: &'static str,
        /// What values it takes.
        range: &'static str,
        /// One of them.
        example: &'static str,
    },
}

impl FromStr for Script {
    type Err = ParseScriptError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (name, value) = text.trim().split_once(':').unwrap_or((text.trim(), ""));
        let number = value.trim().parse::<f64>().ok().filter(|v| v.is_finite());
        let refuse =
            |name, range, example| ParseScriptError::Value { text: text.into(), name, range, example };
        match name {
            "constant-velocity" if value.is_empty() => Ok(Self::ConstantVelocity),
            "brake" => number
                .filter(|v| 0.0 < *v && *v <= HARDEST_BRAKE)
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
            _ => Err(ParseScriptError::Unknown(text.into())),
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

/// The hardest braking that is taken, m/s²: the bound of the acceleration metric.
const HARDEST_BRAKE: f64 = 6.0;
/// Slower than this an AV stands (m/s): recorded positions of a standing AV jitter by a centimetre or two.
const STANDING: f64 = 0.1;
/// Curvature that a step may show by the metric's formula, 1/m; the metric's bound is 0.3.
const CURVATURE: f64 = 0.295;
/// The metric takes no curvature from slower steps, m/s.
const CURVATURE_FROM: f64 = 0.6;

/// An AV that follows a script.
#[derive(Clone, Debug)]
pub struct ScriptedAv {
    track: Vec<AgentState>,
}

impl ScriptedAv {
    /// Plans the script for a scenario: 80 states that obey the kinematic limits.
    ///
    /// # Errors
    /// [`AvError`] when the script follows the log and the logged AV is absent at a step, or jumps.
    pub fn new(scenario: &Scenario, script: Script) -> Result<Self, AvError> {
        let now = scenario.start.now(0);
        let track = if script == Script::ConstantVelocity {
            straight_on(now, velocity_now(scenario))
        } else {
            let log = Log::new(scenario)?;
            let desired = match script {
                Script::Brake(deceleration) => speed::brake(log.speeds[0], deceleration),
                Script::Retime(factor) => speed::retime(&log.speeds, factor),
                Script::Shift(_) | Script::ConstantVelocity => speed::retime(&log.speeds, 1.0),
            };
            let travel = desired.iter().sum::<f64>() * DT;
            let offset = if let Script::Shift(offset) = script { offset } else { 0.0 };
            let path = Path::new(scenario, &log, offset, travel);
            follow(now, log.speeds[0], &path, &desired)
        };
        Ok(Self { track })
    }

    /// The planned states at the steps 1 to 80.
    pub fn track(&self) -> &[AgentState] {
        &self.track
    }
}

impl AvPolicy for ScriptedAv {
    fn next(&mut self, seen: &Observation<'_>) -> Result<AgentState, AvError> {
        Ok(self.track[seen.step()])
    }
}

/// The logged AV from the current frame on.
struct Log {
    /// States at steps 0 to 80.
    states: Vec<AgentState>,
    /// 1 where the AV drives forwards, -1 where it reverses.
    gear: f64,
    /// Speed along the path at steps 0 to 80, m/s, smoothed (but for the first, which is the recorded one); exactly 0 while
    /// the AV stands. Never negative.
    speeds: Vec<f64>,
}

impl Log {
    fn new(scenario: &Scenario) -> Result<Self, AvError> {
        let future = &scenario.log_future.tracks[0];
        let mut states = vec![scenario.start.now(0)];
        for (i, frame) in future.iter().enumerate() {
            states.push(frame.ok_or(AvError::Absent { step: i + 1 })?);
        }
        // A jump would be taken for a speed, and the path made as long as that asks for.
        check_steps(&states[0], &states[1..])?;
        let gear = gear(&states, velocity_now(scenario));
        let speeds = speeds(scenario, &states, gear);
        Ok(Self { states, gear, speeds })
    }
}

/// The AV's forward speed now, m/s, negative in reverse: the recorded one, else by position difference, else 0.
fn velocity_now(scenario: &Scenario) -> f64 {
    let now = scenario.start.now(0);
    if now.velocity().is_some() {
        // The whole speed, as the metrics take it, unless the AV moves sideways.
        let (forward, speed) = (now.forward_speed(), now.speed());
        return if forward.abs() > 0.5 * speed { speed.copysign(forward) } else { forward };
    }
    let before: Frame = scenario.start.history[0][CURRENT - 1];
    let way = before.map_or(0.0, |b| (now.position() - b.position()).dot(&direction(now.heading)));
    // A jump is no speed.
    if way.abs() > LONGEST_STEP { 0.0 } else { way / DT }
}

/// Whether the AV drives forwards (1) or backwards (-1): by its speed or, where it stands, by how it sets off.
fn gear(states: &[AgentState], velocity: f64) -> f64 {
    let ahead = direction(states[0].heading);
    let mut moves = states.iter().map(|s| s.position() - states[0].position());
    let forwards = if velocity.abs() > 0.3 {
        velocity > 0.0
    } else {
        moves.find(|d| d.norm() >= path::SPACING).is_none_or(|d| d.dot(&ahead) > 0.0)
    };
    if forwards { 1.0 } else { -1.0 }
}

/// Speeds along the path by differences over up to 0.6 s, which average the noise of recorded positions out.
fn speeds(scenario: &Scenario, states: &[AgentState], gear: f64) -> Vec<f64> {
    const REACH: usize = 3;
    let history = &scenario.start.history[0];
    let at = |frame: usize| -> Frame {
        if frame < CURRENT { history[frame] } else { states.get(frame - CURRENT).copied() }
    };
    let mut speeds = Vec::with_capacity(states.len());
    for (step, state) in states.iter().enumerate() {
        let frame = step + CURRENT;
        let ahead = direction(state.heading) * gear;
        let reach = REACH.min(states.len() - 1 - step);
        // The way of the box centre, which is not quite along the heading in curves.
        let way = |from: &AgentState, to: &AgentState| {
            let way = to.position() - from.position();
            way.norm().copysign(way.dot(&ahead))
        };
        let raw = match (step, at(frame - reach), at(frame + reach)) {
            (0, ..) => velocity_now(scenario) * gear,
            (_, Some(a), Some(b)) if reach > 0 => way(&a, &b) / (2.0 * reach as f64 * DT),
            _ => way(&states[step - 1], state) / DT,
        };
        speeds.push(if raw < STANDING { 0.0 } else { raw });
    }
    speeds
}

/// The current speed, straight along the heading.
fn straight_on(now: AgentState, speed: f64) -> Vec<AgentState> {
    let speed = if speed.abs() < STANDING { 0.0 } else { speed };
    let velocity = direction(now.heading) * speed;
    let state = |step: usize| {
        let p = now.position() + velocity * (step as f64 * DT);
        AgentState { x: p.x, y: p.y, vx: velocity.x, vy: velocity.y, ..now }
    };
    (1..=FUTURE).map(state).collect()
}

/// Drives along a path at the desired speeds as far as the path and the limits allow.
fn follow(now: AgentState, speed_now: f64, path: &Path, desired: &[f64]) -> Vec<AgentState> {
    let allowed = path.allowed_speeds();
    let (mut s, mut speed, mut state) = (0.0, speed_now, now);
    // Change of speed in the last step, and whether a curve keeps the AV below what is desired.
    let (mut change, mut held) = (0.0, false);
    let mut track = Vec::with_capacity(FUTURE);
    for &wanted in desired {
        // A look ahead gives the braking force time to rise.
        let ceiling = allowed.at(s + 0.5 * (speed + wanted) * DT).min(allowed.at(s + 4.0 * speed * DT));
        held = ceiling < wanted || (held && speed < wanted - speed::EASE);
        let aim = if held {
            let least = (change - 2.0 * speed::EASE).max(-speed::LOSS);
            let most = (change + speed::EASE).clamp(least, speed::GAIN);
            speed + (wanted.min(ceiling) - speed).clamp(least, most)
        } else {
            wanted
        };
        let mut next = aim.clamp((speed - speed::CHANGE).max(0.0), speed + speed::CHANGE);
        if held {
            next = speed::halted(next);
        }
        let mut reached = path.advance(s, state.position(), next * DT);
        // A step that speeds up turns more than its mean speed accounts for: speed up less there.
        for _ in 0..8 {
            let turn = wrap(path.heading(reached) - state.heading).abs();
            let judged = speed >= CURVATURE_FROM && next >= CURVATURE_FROM;
            if next <= speed || !judged || turn <= CURVATURE * 0.5 * (speed + next) * DT {
                break;
            }
            next = 0.5 * (speed + next);
            reached = path.advance(s, state.position(), next * DT);
        }
        if next == 0.0 {
            state = AgentState { vx: 0.0, vy: 0.0, ..state };
        } else {
            let p = path.position(reached);
            let v = (p - state.position()) / DT;
            state = AgentState { x: p.x, y: p.y, heading: path.heading(reached), vx: v.x, vy: v.y };
        }
        (change, s, speed) = (next - speed, reached, next);
        track.push(state);
    }
    track
}

#[cfg(test)]
mod tests;
