//! Motions and lines made of pieces with constant acceleration and curvature.

use reactsim_geometry::{Vec2, direction, left, math, smooth_step};
use reactsim_scene::{AgentState, DT, Frame, Length};

use super::raw::{RawArc, RawMotion, RawPast, RawPath, RawPiece};
use crate::error::Cause;
use crate::frames::seconds;

/// Maximum distance in metres between successive points of a path.
const POINT_SPACING: f64 = 1.0;
/// Maximum length of a piece of a path in metres; a longer one is taken for a typing error.
const MAX_PIECE_LENGTH: f64 = 100_000.0;
/// Maximum number of points of all paths of a scenario.
pub(super) const MAX_POINTS: usize = 1_000_000;

/// Position, heading and speed of a point that moves along a curve.
#[derive(Clone, Copy)]
struct MotionState {
    at: Vec2,
    heading: f64,
    speed: f64,
}

impl MotionState {
    /// Moves by `length` metres along an arc.
    fn advance(&mut self, length: f64, curvature: f64) {
        let turn = curvature * length;
        // The chord of the arc; for a straight piece, sin(x)/x is 1.
        let half = 0.5 * turn;
        let chord = if half == 0.0 { length } else { length * math::sin(half) / half };
        self.at += direction(self.heading + half) * chord;
        self.heading += turn;
    }

    /// Moves for one frame. The speed does not fall below 0.
    fn step(&mut self, acceleration: f64, curvature: f64) {
        let next = self.speed + acceleration * DT;
        let (length, next) = if next < 0.0 {
            (self.speed * self.speed / (-2.0 * acceleration), 0.0)
        } else {
            (0.5 * (self.speed + next) * DT, next)
        };
        self.advance(length, curvature);
        self.speed = next;
    }
}

/// Computes all frames of a motion.
pub(super) fn track(field: &str, motion: &RawMotion, length: Length) -> Result<Vec<Frame>, Cause> {
    let [x, y] = motion.at;
    finite(field, &[("at", x), ("at", y), ("heading", motion.heading), ("speed", motion.speed)])?;
    if motion.speed < 0.0 {
        return Err(Cause::value(format!("{field}.speed"), motion.speed, "at least 0 m/s"));
    }
    let now = MotionState { at: Vec2::new(x, y), heading: motion.heading, speed: motion.speed };
    let mut frames = past(field, now, motion.past, length.current())?;
    frames.extend(future(field, now, &motion.pieces, length.future)?);
    let mut track: Vec<Frame> = frames.into_iter().map(Some).collect();
    if let Some([first, last]) = motion.frames {
        if first > last || last >= track.len() {
            let found = format!("[{first}, {last}]");
            let expected = format!("[first, last] within 0 to {}", track.len() - 1);
            return Err(Cause::value(format!("{field}.frames"), found, expected));
        }
        track[..first].fill(None);
        track[last + 1..].fill(None);
    }
    Ok(track)
}

/// Computes so many states after `now`.
pub(super) fn continuation(
    field: &str,
    now: &AgentState,
    pieces: &[RawPiece],
    count: usize,
) -> Result<Vec<AgentState>, Cause> {
    let speed = now.forward_speed().max(0.0);
    future(field, MotionState { at: now.position(), heading: now.heading, speed }, pieces, count)
}

/// Computes `count` frames before the current one, and that one, by running the motion backwards.
fn past(field: &str, now: MotionState, past: RawPast, count: usize) -> Result<Vec<AgentState>, Cause> {
    let field = format!("{field}.past");
    finite(&field, &[("acceleration", past.acceleration), ("curvature", past.curvature)])?;
    // Backwards, the heading is reversed and acceleration and curvature change sign.
    let mut mover = MotionState { heading: now.heading + std::f64::consts::PI, ..now };
    let mut states = vec![state(&now)];
    for _ in 0..count {
        mover.step(-past.acceleration, -past.curvature);
        states.push(state(&MotionState { heading: mover.heading - std::f64::consts::PI, ..mover }));
    }
    states.reverse();
    Ok(states)
}

fn state(mover: &MotionState) -> AgentState {
    let v = direction(mover.heading) * mover.speed;
    AgentState { x: mover.at.x, y: mover.at.y, heading: mover.heading, vx: v.x, vy: v.y }
}

/// Computes `count` frames after the current one.
fn future(
    field: &str,
    now: MotionState,
    pieces: &[RawPiece],
    count: usize,
) -> Result<Vec<AgentState>, Cause> {
    let mut mover = now;
    let mut states = Vec::with_capacity(count);
    let mut offset = 0.0;
    for (i, piece) in pieces.iter().enumerate() {
        let field = format!("{field}.pieces[{i}]");
        finite(
            &field,
            &[("acceleration", piece.acceleration), ("curvature", piece.curvature), ("shift", piece.shift)],
        )?;
        let steps = steps(&format!("{field}.seconds"), piece.seconds)?;
        if states.len() + steps > count {
            let all = seconds(count);
            let expected = format!("pieces of at most {all} s in total");
            return Err(Cause::value(field, format!("an end after more than {all} s"), expected));
        }
        for k in 1..=steps {
            mover.step(piece.acceleration, piece.curvature);
            // A quintic with zero lateral speed and acceleration at both ends.
            let u = k as f64 / steps as f64;
            let rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / (steps as f64 * DT);
            states.push(shifted(&mover, offset + piece.shift * smooth_step(u), piece.shift * rate));
        }
        offset += piece.shift;
    }
    while states.len() < count {
        mover.step(0.0, 0.0);
        states.push(shifted(&mover, offset, 0.0));
    }
    Ok(states)
}

/// Returns the state at a lateral offset of `offset` metres to the left that grows by `rate` m/s. The heading
/// of a stationary agent does not change.
fn shifted(mover: &MotionState, offset: f64, rate: f64) -> AgentState {
    let ahead = direction(mover.heading);
    let left = left(ahead);
    let turn = if mover.speed > 0.0 { math::atan2(rate, mover.speed) } else { 0.0 };
    let at = mover.at + left * offset;
    let v = ahead * mover.speed + left * rate;
    AgentState { x: at.x, y: at.y, heading: mover.heading + turn, vx: v.x, vy: v.y }
}

/// Converts a duration to a number of frames.
pub(super) fn steps(field: &str, seconds: f64) -> Result<usize, Cause> {
    let steps = seconds / DT;
    if seconds > 0.0 && steps <= Length::MAX_FUTURE as f64 && (steps - steps.round()).abs() < 1e-6 {
        return Ok(steps.round() as usize);
    }
    Err(Cause::value(field, seconds, "a positive multiple of 0.1 s"))
}

/// Samples the points of a path and subtracts their number from `budget`: a short text can describe a long
/// path.
pub(super) fn line(field: &str, path: &RawPath, budget: &mut usize) -> Result<Vec<Vec2>, Cause> {
    let [x, y] = path.at;
    finite(field, &[("at", x), ("at", y), ("heading", path.heading)])?;
    let mut mover = MotionState { at: Vec2::new(x, y), heading: path.heading, speed: 0.0 };
    let mut points = vec![mover.at];
    for (i, &RawArc { length, curvature }) in path.pieces.iter().enumerate() {
        let field = format!("{field}.pieces[{i}]");
        finite(&field, &[("curvature", curvature)])?;
        if !(length > 0.0 && length <= MAX_PIECE_LENGTH) {
            return Err(Cause::value(format!("{field}.length"), length, "a positive length in metres"));
        }
        let start = mover;
        let count = (length / POINT_SPACING).ceil().max(1.0) as usize;
        *budget = budget.checked_sub(count).ok_or_else(|| {
            let expected = "paths of at most 1000 km in total";
            Cause::value(
                format!("{field}.length"),
                format!("{length}, in addition to those before it"),
                expected,
            )
        })?;
        for k in 1..=count {
            mover = start;
            mover.advance(length * (k as f64 / count as f64), curvature);
            points.push(mover.at);
        }
    }
    Ok(points)
}

fn finite(field: &str, values: &[(&str, f64)]) -> Result<(), Cause> {
    match values.iter().find(|(_, v)| !v.is_finite()) {
        Some((name, v)) => Err(Cause::value(format!("{field}.{name}"), v, "a finite number")),
        None => Ok(()),
    }
}
