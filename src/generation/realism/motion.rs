//! How agents move, free of the noise of perception.
//!
//! Differences of states recorded at 10 Hz are mostly noise: 0.1 m/s of it in a velocity are 1.4 m/s² in the difference of two. So a
//! straight line is fitted by least squares over the eleven frames of ±0.5 s (a Savitzky-Golay filter of the first order): its
//! middle is the speed, its slope the acceleration or the yaw rate, and the same noise leaves 0.1 m/s² of itself. What drivers do
//! within less than half a second is lost, in both sets alike.

use crate::geometry::{Vec2, direction, wrap};
use crate::scene::{DT, FRAMES, Scenario};

/// Frames on each side of the middle of a fit.
const REACH: usize = 5;
/// Every so many frames motion is looked at.
pub(super) const STEP: usize = 5;
/// The frames at which it is: those with a whole fit around them.
pub(super) const SAMPLES: usize = (FRAMES - 1 - 2 * REACH) / STEP + 1;
/// A heading that changes more than this between two frames has been flipped by the tracker, radians.
const FLIP: f64 = 0.5;

/// The frame of a sample.
pub(super) fn frame_of(sample: usize) -> usize {
    REACH + STEP * sample
}

/// The sample of the current frame.
pub(super) const NOW: usize = (crate::scene::CURRENT - REACH) / STEP;

/// The motion of an agent at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// Velocity along the heading, m/s; negative in reverse.
    pub(super) speed: f64,
    /// Magnitude of the velocity, m/s.
    pub(super) pace: f64,
    /// Along the heading, m/s².
    pub(super) acceleration: f64,
    /// rad/s; NaN where the heading is flipped.
    pub(super) yaw_rate: f64,
}

/// The motion of an agent at every sample; `None` where it is not present all through the fit.
pub(super) fn motions(scenario: &Scenario, agent: usize) -> [Option<Motion>; SAMPLES] {
    std::array::from_fn(|sample| motion(scenario, agent, frame_of(sample)))
}

fn motion(scenario: &Scenario, agent: usize, frame: usize) -> Option<Motion> {
    const N: usize = 2 * REACH + 1;
    let (mut times, mut speeds, mut headings) = ([0.0; N], [0.0; N], [0.0; N]);
    let mut velocity = Vec2::zeros();
    let mut flipped = false;
    for i in 0..N {
        let f = frame - REACH + i;
        let state = scenario.logged_at(agent, f)?;
        let v = scenario.logged_velocity(agent, f)?;
        times[i] = time(scenario, f);
        speeds[i] = v.dot(&direction(state.heading));
        velocity += v / N as f64;
        headings[i] = match i {
            0 => state.heading,
            _ => {
                let turn = wrap(state.heading - headings[i - 1]);
                flipped |= turn.abs() > FLIP;
                headings[i - 1] + turn
            }
        };
    }
    let (speed, acceleration) = line(&times, &speeds);
    let yaw_rate = if flipped { f64::NAN } else { line(&times, &headings).1 };
    Some(Motion { speed, pace: velocity.norm(), acceleration, yaw_rate })
}

/// The time of a frame, seconds: recorders drop frames now and then.
fn time(scenario: &Scenario, frame: usize) -> f64 {
    scenario.timestamps.get(frame).copied().unwrap_or(frame as f64 * DT)
}

/// Mean and slope of the line through these points with the least squares.
fn line(times: &[f64], values: &[f64]) -> (f64, f64) {
    let n = times.len() as f64;
    let (t0, mean) = (times.iter().sum::<f64>() / n, values.iter().sum::<f64>() / n);
    let spread: f64 = times.iter().map(|t| (t - t0) * (t - t0)).sum();
    let slope: f64 = times.iter().zip(values).map(|(t, v)| (t - t0) * (v - mean)).sum();
    (mean, if spread > 0.0 { slope / spread } else { f64::NAN })
}

/// Distance of the farthest logged position from that of the current frame, metres, and the number of frames with one.
pub(super) fn extent(scenario: &Scenario, agent: usize) -> (f64, usize) {
    let now = scenario.start.now(agent).position();
    let states = (0..FRAMES).filter_map(|f| scenario.logged_at(agent, f));
    states.fold((0.0, 0), |(far, n), s| (f64::max(far, (s.position() - now).norm()), n + 1))
}

/// Length of the logged way from a frame on, metres; over gaps it is straight.
pub(super) fn way(scenario: &Scenario, agent: usize, from: usize) -> f64 {
    let mut states = (from..FRAMES).filter_map(|f| scenario.logged_at(agent, f));
    let Some(mut last) = states.next() else { return 0.0 };
    let step = |s: crate::scene::AgentState| {
        let d = (s.position() - last.position()).norm();
        last = s;
        d
    };
    states.map(step).sum()
}

/// By how much the logged heading ranges over the window, radians; `None` where it is flipped in between.
pub(super) fn turn(scenario: &Scenario, agent: usize) -> Option<f64> {
    let headings = (0..FRAMES).filter_map(|f| scenario.logged_at(agent, f)).map(|s| s.heading);
    let (mut before, mut total, mut low, mut high) = (None, 0.0_f64, 0.0_f64, 0.0_f64);
    for heading in headings {
        let step = before.map_or(0.0, |b: f64| wrap(heading - b));
        if step.abs() > FLIP {
            return None;
        }
        (before, total) = (Some(heading), total + step);
        (low, high) = (low.min(total), high.max(total));
    }
    Some(high - low)
}
