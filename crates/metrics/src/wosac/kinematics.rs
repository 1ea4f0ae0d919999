//! Speeds and accelerations by central differences, in single precision as in the official code.

use reactsim_scene::{FRAMES, FUTURE, HISTORY};

use super::objects::Motion;

/// Time between two frames, seconds.
const DT: f32 = 0.1;
/// Square of the time between two frames as the official code rounds it, s².
const DT_SQUARED: f32 = 0.01;
const PI: f32 = std::f32::consts::PI;
const TWO_PI: f32 = std::f32::consts::TAU;

/// Computes speed in three dimensions (m/s), its change (m/s²), yaw rate (rad/s) and its change (rad/s²) of
/// an object at the steps 1 to 80. Speeds are NaN at step 80, accelerations at the steps 79 and 80. Values at
/// invalid frames enter as stored.
pub(super) fn kinematics(motion: &Motion, object: usize) -> [[f32; FUTURE]; 4] {
    let (track, future) = (motion.tracks[object], &motion.futures[object]);
    let [dx, dy, dz] = [(&track.x, future.x), (&track.y, future.y), (&track.z, future.z)]
        .map(|(history, future)| central_difference(&Motion::frames(history, future)));
    let mut speed = [f32::NAN; FRAMES];
    for (f, speed) in speed.iter_mut().enumerate() {
        *speed = (dx[f] * dx[f] + dy[f] * dy[f] + dz[f] * dz[f]).sqrt() / DT;
    }
    let turn = central_turn(&Motion::frames(&track.heading, future.heading));
    [
        judged(&speed),
        judged(&central_difference(&speed).map(|change| change / DT)),
        judged(&turn.map(|turn| turn / DT)),
        judged(&central_turn(&turn).map(|change| change / DT_SQUARED)),
    ]
}

/// Returns the values of the frames 11 to 90.
fn judged(frames: &[f32; FRAMES]) -> [f32; FUTURE] {
    let mut steps = [0.0; FUTURE];
    steps.copy_from_slice(&frames[HISTORY..]);
    steps
}

/// Returns half the difference of the neighbouring values; NaN at both ends.
fn central_difference(values: &[f32; FRAMES]) -> [f32; FRAMES] {
    let mut difference = [f32::NAN; FRAMES];
    for f in 1..FRAMES - 1 {
        difference[f] = (values[f + 1] - values[f - 1]) / 2.0;
    }
    difference
}

/// Returns half the wrapped difference of the neighbouring angles; NaN at both ends.
fn central_turn(angles: &[f32; FRAMES]) -> [f32; FRAMES] {
    central_difference(angles).map(|difference| wrap(2.0 * difference) / 2.0)
}

/// Wraps an angle to [-pi, pi) by a floor modulo in single precision.
fn wrap(angle: f32) -> f32 {
    let shifted = angle + PI;
    // The remainder has the sign of the dividend; it is exact.
    let remainder = if shifted.abs() < TWO_PI { shifted } else { shifted % TWO_PI };
    let modulo = if remainder < 0.0 { remainder + TWO_PI } else { remainder };
    modulo - PI
}

/// Returns the speed of an object in the plane at a future step (counted from 0), m/s; NaN at the last one.
pub(super) fn planar_speed(motion: &Motion, object: usize, step: usize) -> f32 {
    if step + 1 == FUTURE {
        return f32::NAN;
    }
    let (before, future) = (motion.before(object, step), &motion.futures[object]);
    let dx = (future.x[step + 1] - before[0]) / 2.0;
    let dy = (future.y[step + 1] - before[1]) / 2.0;
    (dx * dx + dy * dy).sqrt() / DT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn angles_are_wrapped_by_a_floor_modulo() {
        for (angle, expected) in
            [(0.0, 0.0), (PI, -PI), (-PI, -PI), (7.0, 7.0 - TWO_PI), (-7.0, TWO_PI - 7.0)]
        {
            assert!((wrap(angle) - expected).abs() < 1e-6, "{angle}: {}", wrap(angle));
        }
        assert!((wrap(100.0) - (100.0 - 16.0 * TWO_PI)).abs() < 1e-5);
        assert!(wrap(f32::NAN).is_nan());
    }

    #[test]
    fn the_second_difference_of_angles_is_wrapped_too() {
        // Turns of +1.5 and -1.7 rad differ by 3.2 rad, more than half a turn.
        let mut turn = [0.0; FRAMES];
        (turn[20], turn[22]) = (1.5, -1.7);
        let expected = (TWO_PI - 3.2) / 2.0;
        assert!((central_turn(&turn)[21] - expected).abs() < 1e-6);
    }
}
