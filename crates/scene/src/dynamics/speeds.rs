//! Speed profiles of the steps of a rollout, m/s: `speeds[k]` is the distance travelled in step k + 1 divided
//! by 0.1 s.

use reactsim_geometry::math;

use crate::DT;

/// Largest change of speed in one step, m/s: the bound of the acceleration metric, 6 m/s², over 0.1
/// s.
pub const MAX_SPEED_CHANGE: f64 = 0.6;
/// Largest gain of speed in one step after a curve, m/s.
pub const MAX_CURVE_SPEED_GAIN: f64 = MAX_PLANNED_ACCELERATION * DT;
/// Largest loss of speed in one step before a curve, m/s.
pub const MAX_CURVE_SPEED_LOSS: f64 = MAX_PLANNED_DECELERATION * DT;
/// Largest increase from step to step of the speed gain per step, m/s: a jerk of 15 m/s³. The gain
/// may decrease twice as fast.
pub const SPEED_GAIN_STEP: f64 = 0.15;
/// Longest duration over which the deceleration builds up or fades, s.
const MAX_BRAKE_RAMP: f64 = 0.5;
/// Largest peak deceleration of a braking profile with ramps, m/s².
const MAX_PEAK_DECELERATION: f64 = 5.9;
/// Largest planned acceleration, m/s².
pub const MAX_PLANNED_ACCELERATION: f64 = 4.0;
/// Largest planned deceleration, m/s².
pub const MAX_PLANNED_DECELERATION: f64 = 5.0;
/// Largest acceleration that a change of the time scale may cause, m/s².
const MAX_RETIMING_ACCELERATION: f64 = 2.5;
/// Speed below which a vehicle counts as halted, m/s.
const HALT_SPEED: f64 = 0.05;

/// Returns a profile of `steps` steps that brakes from `speed` to a halt in the time `speed / deceleration`.
///
/// The deceleration builds up and fades over a ramp. Its mean is exactly `deceleration`, and so the
/// braking distance is `speed² / (2 deceleration)`.
pub fn brake(speed: f64, deceleration: f64, steps: usize) -> Vec<f64> {
    let duration = speed / deceleration;
    let ramp = MAX_BRAKE_RAMP
        .min(duration / 5.0)
        .min(duration * (1.0 - deceleration / MAX_PEAK_DECELERATION))
        .max(0.0);
    let peak = if duration > ramp { speed / (duration - ramp) } else { 0.0 };
    // Distance after t: the deceleration is a trapezoid, so the distance is a cubic, a parabola and
    // a cubic.
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
    mean_speeds(distance, steps)
}

/// Returns the speeds of the log over `steps` steps with time running faster or slower.
///
/// The time scale goes from 1 to `factor` over a smooth ramp that is long enough to keep the
/// acceleration bounded. After the end of the log its last speed continues.
pub fn retime(log: &[f64], factor: f64, steps: usize) -> Vec<f64> {
    let early = log.iter().take(30).fold(0.0_f64, |a, &v| a.max(v));
    // The steepest slope of the smooth step is 1.5 / duration.
    let duration = (1.5 * (factor - 1.0).abs() * early / MAX_RETIMING_ACCELERATION).max(1.0);
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
    for k in 0..steps {
        time += scale((k as f64 + 0.5) * DT) * DT;
        times.push(time);
    }
    let mut speeds: Vec<f64> = times.windows(2).map(|t| (travelled(t[1]) - travelled(t[0])) / DT).collect();
    bound(log[0], &mut speeds, MAX_PLANNED_ACCELERATION, MAX_PLANNED_DECELERATION);
    soften(log[0], &mut speeds);
    speeds
}

/// Returns the mean speeds of the first steps of a motion given by its distance as a function of time.
fn mean_speeds(distance: impl Fn(f64) -> f64, steps: usize) -> Vec<f64> {
    let at = |k: usize| distance(k as f64 * DT);
    (0..steps).map(|k| halted(((at(k + 1) - at(k)) / DT).max(0.0))).collect()
}

/// Returns the speed, or 0 if it is below the threshold of a halt.
pub fn halted(speed: f64) -> f64 {
    if speed < HALT_SPEED { 0.0 } else { speed }
}

/// Lowers speeds until they can be driven from the speed `now` within these bounds of acceleration
/// and deceleration (m/s²): braking begins earlier, speeding up takes longer.
pub fn bound(now: f64, speeds: &mut [f64], acceleration: f64, deceleration: f64) {
    for k in (0..speeds.len() - 1).rev() {
        speeds[k] = speeds[k].min(speeds[k + 1] + deceleration * DT);
    }
    bound_ahead(now, speeds, acceleration, deceleration);
}

/// Changes speeds until they can be driven from the speed `now` within these bounds of acceleration
/// and deceleration (m/s²), without anticipation: braking begins when it is demanded, and ends
/// later.
pub fn bound_ahead(now: f64, speeds: &mut [f64], acceleration: f64, deceleration: f64) {
    let mut before = now;
    for speed in speeds {
        *speed = speed.clamp((before - deceleration * DT).max(0.0), before + acceleration * DT);
        before = *speed;
    }
}

/// Averages speeds over five steps, which bounds the jerk and increases no acceleration.
///
/// Before the first step the speeds continue by point reflection about `now`, so that the average
/// starts from it.
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

/// Number of steps over which a change of the acceleration is spread.
const SPREAD_STEPS: usize = 7;
/// Time constant with which the initial acceleration fades, s.
const FADE_TIME: f64 = 0.4;

/// Spreads every change of the acceleration over 0.7 s, starting from the current speed `now` and
/// its `acceleration` (m/s²). The result lags 0.3 s behind, like a driver who reacts.
///
/// The difference between the speeds and those of a vehicle whose acceleration only fades is
/// averaged over the last steps.
pub fn soften_from(now: f64, acceleration: f64, speeds: &mut [f64]) {
    let faded =
        |k: usize| now + acceleration * FADE_TIME * (1.0 - math::exp(-((k + 1) as f64) * DT / FADE_TIME));
    let raw = speeds.to_vec();
    for (k, speed) in speeds.iter_mut().enumerate() {
        let first = (k + 1).saturating_sub(SPREAD_STEPS);
        let window = &raw[first..=k];
        let excess: f64 = window.iter().enumerate().map(|(i, v)| v - faded(first + i)).sum();
        let stationary = window.len() == SPREAD_STEPS && window.iter().all(|&v| v == 0.0);
        *speed = if stationary { 0.0 } else { halted((faded(k) + excess / SPREAD_STEPS as f64).max(0.0)) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::FUTURE;

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
