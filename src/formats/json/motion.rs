//! Motions and lines from pieces of constant acceleration and curvature.

use super::raw::{RawArc, RawMotion, RawPast, RawPath, RawPiece};
use crate::formats::error::Cause;
use crate::geometry::{Vec2, direction, left, math, smooth_step};
use crate::scene::{AgentState, CURRENT, DT, FRAMES, FUTURE, Frame, HISTORY};

/// Distance between two points of a path, metres.
const SPACING: f64 = 1.0;
/// Longest path, metres: a longer one is a slip of the pen.
const LONGEST_PATH: f64 = 100_000.0;
/// Most points of all paths of a scenario.
pub(super) const MOST_POINTS: usize = 1_000_000;

/// A point that moves along a curve.
#[derive(Clone, Copy)]
struct Mover {
    at: Vec2,
    heading: f64,
    speed: f64,
}

impl Mover {
    /// Moves so far along an arc.
    fn roll(&mut self, length: f64, curvature: f64) {
        let turn = curvature * length;
        // The chord of the arc; for a straight piece sin(x)/x is 1.
        let half = 0.5 * turn;
        let chord = if half == 0.0 { length } else { length * math::sin(half) / half };
        self.at += direction(self.heading + half) * chord;
        self.heading += turn;
    }

    /// Moves for one frame. The speed stops at 0.
    fn step(&mut self, acceleration: f64, curvature: f64) {
        let next = self.speed + acceleration * DT;
        let (length, next) = if next < 0.0 {
            (self.speed * self.speed / (-2.0 * acceleration), 0.0)
        } else {
            (0.5 * (self.speed + next) * DT, next)
        };
        self.roll(length, curvature);
        self.speed = next;
    }
}

/// The 91 frames of a motion.
pub(super) fn track(field: &str, motion: &RawMotion) -> Result<Vec<Frame>, Cause> {
    let [x, y] = motion.at;
    finite(field, &[("at", x), ("at", y), ("heading", motion.heading), ("speed", motion.speed)])?;
    if motion.speed < 0.0 {
        return Err(Cause::value(format!("{field}.speed"), motion.speed, "at least 0 m/s"));
    }
    let now = Mover { at: Vec2::new(x, y), heading: motion.heading, speed: motion.speed };
    let mut frames = past(field, now, motion.past)?;
    frames.extend(future(field, now, &motion.pieces)?);
    let mut track: Vec<Frame> = frames.into_iter().map(Some).collect();
    if let Some([first, last]) = motion.frames {
        if first > last || last >= FRAMES {
            let found = format!("[{first}, {last}]");
            return Err(Cause::value(format!("{field}.frames"), found, "[first, last] within 0 to 90"));
        }
        track[..first].fill(None);
        track[last + 1..].fill(None);
    }
    Ok(track)
}

/// The 80 states after `now`.
pub(super) fn continuation(
    field: &str,
    now: &AgentState,
    pieces: &[RawPiece],
) -> Result<Vec<AgentState>, Cause> {
    let speed = now.forward_speed().max(0.0);
    future(field, Mover { at: now.position(), heading: now.heading, speed }, pieces)
}

/// Frames 0 to 10: the motion run backwards.
fn past(field: &str, now: Mover, past: RawPast) -> Result<Vec<AgentState>, Cause> {
    let field = format!("{field}.past");
    finite(&field, &[("acceleration", past.acceleration), ("curvature", past.curvature)])?;
    // Backwards the point looks the other way, and speeds up where it slowed down.
    let mut mover = Mover { heading: now.heading + std::f64::consts::PI, ..now };
    let mut states = vec![state(&now)];
    for _ in 0..CURRENT {
        mover.step(-past.acceleration, -past.curvature);
        states.push(state(&Mover { heading: mover.heading - std::f64::consts::PI, ..mover }));
    }
    states.reverse();
    debug_assert_eq!(states.len(), HISTORY);
    Ok(states)
}

fn state(mover: &Mover) -> AgentState {
    let v = direction(mover.heading) * mover.speed;
    AgentState { x: mover.at.x, y: mover.at.y, heading: mover.heading, vx: v.x, vy: v.y }
}

/// Frames 11 to 90.
fn future(field: &str, now: Mover, pieces: &[RawPiece]) -> Result<Vec<AgentState>, Cause> {
    let mut mover = now;
    let mut states = Vec::with_capacity(FUTURE);
    let mut aside = 0.0;
    for (i, piece) in pieces.iter().enumerate() {
        let field = format!("{field}.pieces[{i}]");
        finite(
            &field,
            &[("acceleration", piece.acceleration), ("curvature", piece.curvature), ("shift", piece.shift)],
        )?;
        let steps = steps(&format!("{field}.seconds"), piece.seconds)?;
        if states.len() + steps > FUTURE {
            return Err(Cause::value(field, "an end after more than 8 s", "pieces of 8 s together at most"));
        }
        for k in 1..=steps {
            mover.step(piece.acceleration, piece.curvature);
            // A quintic: it begins and ends without sideways speed and acceleration.
            let u = k as f64 / steps as f64;
            let rate = 30.0 * u * u * (1.0 - u) * (1.0 - u) / (steps as f64 * DT);
            states.push(shifted(&mover, aside + piece.shift * smooth_step(u), piece.shift * rate));
        }
        aside += piece.shift;
    }
    while states.len() < FUTURE {
        mover.step(0.0, 0.0);
        states.push(shifted(&mover, aside, 0.0));
    }
    Ok(states)
}

/// The state beside a point: so far to the left, moving left at this rate. An agent that stands does not turn.
fn shifted(mover: &Mover, aside: f64, rate: f64) -> AgentState {
    let ahead = direction(mover.heading);
    let left = left(ahead);
    let turn = if mover.speed > 0.0 { math::atan2(rate, mover.speed) } else { 0.0 };
    let at = mover.at + left * aside;
    let v = ahead * mover.speed + left * rate;
    AgentState { x: at.x, y: at.y, heading: mover.heading + turn, vx: v.x, vy: v.y }
}

/// The number of frames in a time.
pub(super) fn steps(field: &str, seconds: f64) -> Result<usize, Cause> {
    let steps = seconds / DT;
    if seconds > 0.0 && steps <= 1000.0 && (steps - steps.round()).abs() < 1e-6 {
        return Ok(steps.round() as usize);
    }
    Err(Cause::value(field, seconds, "a positive multiple of 0.1 s"))
}

/// The points of a path, of which there may be `left` more: few words can mean a long path.
pub(super) fn line(field: &str, path: &RawPath, left: &mut usize) -> Result<Vec<Vec2>, Cause> {
    let [x, y] = path.at;
    finite(field, &[("at", x), ("at", y), ("heading", path.heading)])?;
    let mut mover = Mover { at: Vec2::new(x, y), heading: path.heading, speed: 0.0 };
    let mut points = vec![mover.at];
    for (i, &RawArc { length, curvature }) in path.pieces.iter().enumerate() {
        let field = format!("{field}.pieces[{i}]");
        finite(&field, &[("curvature", curvature)])?;
        if !(length > 0.0 && length <= LONGEST_PATH) {
            return Err(Cause::value(format!("{field}.length"), length, "a positive length in metres"));
        }
        let start = mover;
        let count = (length / SPACING).ceil().max(1.0) as usize;
        *left = left.checked_sub(count).ok_or_else(|| {
            let expected = "paths of 1000 km together at most";
            Cause::value(format!("{field}.length"), format!("{length}, beside those before it"), expected)
        })?;
        for k in 1..=count {
            mover = start;
            mover.roll(length * (k as f64 / count as f64), curvature);
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
