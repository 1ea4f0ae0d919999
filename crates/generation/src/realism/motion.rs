//! Motion of agents, smoothed against perception noise.
//!
//! Differences of states recorded at 10 Hz are mostly noise: a velocity noise of 0.1 m/s becomes 1.4 m/s²
//! in the difference of two velocities. Instead, a straight line is fitted by least squares over the eleven
//! frames of ±0.5 s (a first-order Savitzky-Golay filter): its middle is the speed, its slope the
//! acceleration or the yaw rate, and only 0.1 m/s² of the noise remains. Behaviour shorter than half a
//! second is lost, in both sets alike.

use reactsim_geometry::{Vec2, direction, wrap};
use reactsim_scene::{DT, FRAMES, Scenario};

/// Number of frames on each side of the middle of a fit.
const FIT_HALF_FRAMES: usize = 5;
/// Interval between two samples, frames.
pub(super) const SAMPLE_STEP: usize = 5;
/// Number of samples: the frames with a complete fit around them.
pub(super) const SAMPLES: usize = (FRAMES - 1 - 2 * FIT_HALF_FRAMES) / SAMPLE_STEP + 1;
/// Heading change between two frames, radians, above which the tracker has flipped the heading.
const FLIP_ANGLE: f64 = 0.5;

/// Returns the frame of a sample.
pub(super) fn frame_of(sample: usize) -> usize {
    FIT_HALF_FRAMES + SAMPLE_STEP * sample
}

/// Index of the sample at the current frame.
pub(super) const CURRENT_SAMPLE: usize = (reactsim_scene::CURRENT - FIT_HALF_FRAMES) / SAMPLE_STEP;

/// Motion of an agent at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Motion {
    /// Velocity along the heading, m/s; negative in reverse.
    pub(super) speed: f64,
    /// Magnitude of the velocity, m/s.
    pub(super) pace: f64,
    /// Acceleration along the heading, m/s².
    pub(super) acceleration: f64,
    /// Yaw rate, rad/s; NaN if the heading is flipped.
    pub(super) yaw_rate: f64,
}

/// Returns the motion of an agent at every sample; `None` where it is not present throughout the fit.
pub(super) fn motions(scenario: &Scenario, agent: usize) -> [Option<Motion>; SAMPLES] {
    std::array::from_fn(|sample| motion(scenario, agent, frame_of(sample)))
}

fn motion(scenario: &Scenario, agent: usize, frame: usize) -> Option<Motion> {
    const N: usize = 2 * FIT_HALF_FRAMES + 1;
    let (mut times, mut speeds, mut headings) = ([0.0; N], [0.0; N], [0.0; N]);
    let mut velocity = Vec2::zeros();
    let mut flipped = false;
    for i in 0..N {
        let f = frame - FIT_HALF_FRAMES + i;
        let state = scenario.logged_at(agent, f)?;
        let v = scenario.logged_velocity(agent, f)?;
        times[i] = time(scenario, f);
        speeds[i] = v.dot(&direction(state.heading));
        velocity += v / N as f64;
        headings[i] = match i {
            0 => state.heading,
            _ => {
                let turn = wrap(state.heading - headings[i - 1]);
                flipped |= turn.abs() > FLIP_ANGLE;
                headings[i - 1] + turn
            }
        };
    }
    let (speed, acceleration) = line(&times, &speeds);
    let yaw_rate = if flipped { f64::NAN } else { line(&times, &headings).1 };
    Some(Motion { speed, pace: velocity.norm(), acceleration, yaw_rate })
}

/// Returns the time of a frame, seconds, since recorders occasionally drop frames.
fn time(scenario: &Scenario, frame: usize) -> f64 {
    scenario.timestamps.get(frame).copied().unwrap_or(frame as f64 * DT)
}

/// Returns the mean and the slope of the least-squares line through these points.
fn line(times: &[f64], values: &[f64]) -> (f64, f64) {
    let n = times.len() as f64;
    let (t0, mean) = (times.iter().sum::<f64>() / n, values.iter().sum::<f64>() / n);
    let spread: f64 = times.iter().map(|t| (t - t0) * (t - t0)).sum();
    let slope: f64 = times.iter().zip(values).map(|(t, v)| (t - t0) * (v - mean)).sum();
    (mean, if spread > 0.0 { slope / spread } else { f64::NAN })
}

/// Returns the distance of the farthest logged position from that of the current frame, metres, and the
/// number of frames with a position.
pub(super) fn extent(scenario: &Scenario, agent: usize) -> (f64, usize) {
    let now = scenario.start.now(agent).position();
    let states = (0..FRAMES).filter_map(|f| scenario.logged_at(agent, f));
    states.fold((0.0, 0), |(far, n), s| (f64::max(far, (s.position() - now).norm()), n + 1))
}

/// Returns the length of the logged path from a frame on, metres; gaps are bridged by straight lines.
pub(super) fn path_length(scenario: &Scenario, agent: usize, from: usize) -> f64 {
    let mut states = (from..FRAMES).filter_map(|f| scenario.logged_at(agent, f));
    let Some(mut last) = states.next() else { return 0.0 };
    let step = |s: reactsim_scene::AgentState| {
        let d = (s.position() - last.position()).norm();
        last = s;
        d
    };
    states.map(step).sum()
}

/// Returns the range of the logged heading over the window, radians; `None` if the heading is flipped in
/// between.
pub(super) fn turn(scenario: &Scenario, agent: usize) -> Option<f64> {
    let headings = (0..FRAMES).filter_map(|f| scenario.logged_at(agent, f)).map(|s| s.heading);
    let (mut before, mut total, mut low, mut high) = (None, 0.0_f64, 0.0_f64, 0.0_f64);
    for heading in headings {
        let step = before.map_or(0.0, |b: f64| wrap(heading - b));
        if step.abs() > FLIP_ANGLE {
            return None;
        }
        (before, total) = (Some(heading), total + step);
        (low, high) = (low.min(total), high.max(total));
    }
    Some(high - low)
}
