//! Speed profiles of the 80 steps, m/s: `speeds[k]` is the distance of step k + 1 over 0.1 s.

use crate::geometry::math;
use crate::scene::{DT, FUTURE};

/// Largest change of speed between two steps, m/s: the bound of the acceleration metric, 6 m/s².
pub const CHANGE: f64 = 0.6;
/// Largest gain of speed between two steps after a curve, m/s.
pub const GAIN: f64 = ACCELERATION * DT;
/// Largest loss of speed between two steps before a curve, m/s.
pub const LOSS: f64 = DECELERATION * DT;
/// By how much that gain may grow from step to step, m/s: a jerk of 15 m/s³; it may fall twice as fast.
pub const EASE: f64 = 0.15;
/// Longest rise and fall of the braking force, s.
const BRAKE_RAMP: f64 = 0.5;
/// Peak deceleration that a ramp may lead to, m/s².
const BRAKE_PEAK: f64 = 5.9;
/// Speeding up is kept below this, m/s².
pub const ACCELERATION: f64 = 4.0;
/// Slowing down is kept below this, m/s².
pub const DECELERATION: f64 = 5.0;
/// Share of the acceleration that changing the time scale may use, m/s².
const RAMP: f64 = 2.5;
/// Slower than this is a halt, m/s.
const HALT: f64 = 0.05;

/// Brakes from `speed` to a halt in the time `speed / deceleration`: the force rises and falls by a ramp, its mean is what was
/// asked, and so is the way to the halt, `speed² / (2 deceleration)`.
pub fn brake(speed: f64, deceleration: f64) -> Vec<f64> {
    let duration = speed / deceleration;
    let ramp = BRAKE_RAMP.min(duration / 5.0).min(duration * (1.0 - deceleration / BRAKE_PEAK)).max(0.0);
    let peak = if duration > ramp { speed / (duration - ramp) } else { 0.0 };
    // Distance after t: the force is a trapezoid, so the distance is a cubic, a parabola and a cubic.
    let rise = |t: f64| if ramp > 0.0 { peak * t * t * t / (6.0 * ramp) } else { 0.0 };
    let distance = |t: f64| {
        let t = t.min(duration);
        if t <= ramp {
            speed * t - rise(t)
        } else if t <= duration - ramp {
            let u = t - ramp;
            speed * t - rise(ramp) - 0.5 * peak * ramp * u - 0.5 * peak * u * u
        } else {
            0.5 * speed * duration - rise(duration - t)
        }
    };
    steps(distance)
}

/// The speeds of the log with time running faster or slower: the time scale goes from 1 to `factor` by a smooth ramp whose length
/// keeps the acceleration bounded. After the log's end the last speed goes on.
pub fn retime(log: &[f64], factor: f64) -> Vec<f64> {
    let early = log.iter().take(30).fold(0.0_f64, |a, &v| a.max(v));
    // The steepest slope of the smooth step is 1.5 / duration.
    let duration = (1.5 * (factor - 1.0).abs() * early / RAMP).max(1.0);
    let scale = |t: f64| {
        let u = (t / duration).min(1.0);
        1.0 + (factor - 1.0) * u * u * (3.0 - 2.0 * u)
    };
    let mut arc = vec![0.0];
    for pair in log.windows(2) {
        arc.push(arc[arc.len() - 1] + 0.5 * (pair[0] + pair[1]) * DT);
    }
    let last = log.len() - 1;
    let travelled = |time: f64| {
        let frames = time / DT;
        let i = (frames as usize).min(last);
        let rest = frames - i as f64;
        if i == last { arc[last] + rest * DT * log[last] } else { arc[i] + rest * (arc[i + 1] - arc[i]) }
    };
    let (mut time, mut times) = (0.0, vec![0.0]);
    for k in 0..FUTURE {
        time += scale((k as f64 + 0.5) * DT) * DT;
        times.push(time);
    }
    let mut speeds: Vec<f64> = times.windows(2).map(|t| (travelled(t[1]) - travelled(t[0])) / DT).collect();
    bound(log[0], &mut speeds, ACCELERATION, DECELERATION);
    soften(log[0], &mut speeds);
    speeds
}

/// The mean speeds of the 80 steps of a motion given by its distance over time.
fn steps(distance: impl Fn(f64) -> f64) -> Vec<f64> {
    let at = |k: usize| distance(k as f64 * DT);
    (0..FUTURE).map(|k| halted(((at(k + 1) - at(k)) / DT).max(0.0))).collect()
}

/// The speed, or 0 where it is a halt.
pub fn halted(speed: f64) -> f64 {
    if speed < HALT { 0.0 } else { speed }
}

/// Lowers speeds until they can be driven from `now` on with these bounds of the acceleration (m/s²): braking begins earlier, speeding
/// up takes longer.
pub fn bound(now: f64, speeds: &mut [f64], acceleration: f64, deceleration: f64) {
    for k in (0..speeds.len() - 1).rev() {
        speeds[k] = speeds[k].min(speeds[k + 1] + deceleration * DT);
    }
    bound_ahead(now, speeds, acceleration, deceleration);
}

/// Changes speeds until they can be driven from `now` on with these bounds of the acceleration (m/s²), as by somebody who does not look
/// ahead: braking begins when it is asked for, and ends later.
pub fn bound_ahead(now: f64, speeds: &mut [f64], acceleration: f64, deceleration: f64) {
    let mut before = now;
    for speed in speeds {
        *speed = speed.clamp((before - deceleration * DT).max(0.0), before + acceleration * DT);
        before = *speed;
    }
}

/// Averages over five steps, which bounds the jerk and no acceleration grows. Before the first step the speeds are mirrored
/// at `now` and turned over, so that they go on from it.
pub fn soften(now: f64, speeds: &mut [f64]) {
    let raw = speeds.to_vec();
    let at = |k: isize| match k {
        k if k < 0 => 2.0 * now - if k == -1 { now } else { raw[(-k - 2) as usize] },
        k => raw[(k as usize).min(raw.len() - 1)],
    };
    for (k, speed) in speeds.iter_mut().enumerate() {
        let k = k as isize;
        *speed = halted((at(k - 2) + at(k - 1) + at(k) + at(k + 1) + at(k + 2)) / 5.0);
    }
}

/// Steps over which a change of the acceleration is spread.
const SPREAD: usize = 7;
/// Time in which an acceleration fades that nobody asks for any more, s.
const FADE: f64 = 0.4;

/// Spreads every change of the acceleration over 0.7 s, for a vehicle that speeds up by `acceleration` (m/s²) until now: the speeds go on
/// from it. They come 0.3 s late, as those of somebody who reacts.
///
/// What is averaged, over the last steps, is how far the speeds are from those of a vehicle whose acceleration only fades.
pub fn soften_from(now: f64, acceleration: f64, speeds: &mut [f64]) {
    let faded = |k: usize| now + acceleration * FADE * (1.0 - math::exp(-((k + 1) as f64) * DT / FADE));
    let raw = speeds.to_vec();
    for (k, speed) in speeds.iter_mut().enumerate() {
        let first = (k + 1).saturating_sub(SPREAD);
        let asked = &raw[first..=k];
        let apart: f64 = asked.iter().enumerate().map(|(i, v)| v - faded(first + i)).sum();
        let stands = asked.len() == SPREAD && asked.iter().all(|&v| v == 0.0);
        *speed = if stands { 0.0 } else { halted((faded(k) + apart / SPREAD as f64).max(0.0)) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn softened_speeds_go_on_from_the_acceleration() {
        for (now, before) in [(10.0, 1.5), (10.0, -3.0), (3.0, 0.0)] {
            let mut speeds = vec![now; FUTURE];
            for (k, v) in speeds.iter_mut().enumerate() {
                *v = (now - 0.5 * (k + 1) as f64).max(0.0);
            }
            soften_from(now, before, &mut speeds);
            let (mut v0, mut a0) = (now, before);
            for &v in &speeds {
                let a = (v - v0) / DT;
                assert!((a - a0).abs() / DT <= 18.0, "from {before}: {a0} to {a} m/s2");
                (v0, a0) = (v, a);
            }
            assert_eq!(speeds[FUTURE - 1], 0.0);
        }
    }
}
