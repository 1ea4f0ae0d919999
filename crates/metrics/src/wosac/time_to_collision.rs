//! Time to collision of evaluated objects with the object ahead, in the plane.

use reactsim_geometry::math;
use reactsim_scene::FUTURE;

use super::kinematics::planar_speed;
use super::objects::Motion;

/// Longest time to collision in seconds; also the value without an object ahead, or if it is not approached.
const MAX_TTC: f64 = 5.0;
/// Largest heading difference to an object ahead, radians: 75 degrees.
const MAX_HEADING_DIFFERENCE: f32 = 75.0 * (std::f32::consts::PI / 180.0);
/// Largest heading difference to an object that is hardly in the way, radians: 10 degrees.
const SMALL_OVERLAP_HEADING_DIFFERENCE: f32 = 10.0 * (std::f32::consts::PI / 180.0);
/// Lateral overlap in metres up to which an object is hardly in the way.
const SMALL_OVERLAP: f64 = 0.5;
/// Widening of the coarse test for objects ahead, metres.
const BOUND_SLACK: f32 = 1e-2;
/// Widening of the coarse test for objects ahead, relative to their distance.
const RELATIVE_SLACK: f32 = 1e-5;

/// The object ahead at a step.
#[derive(Clone, Copy)]
struct Leader {
    /// Distance along the heading between the boxes, metres.
    gap: f64,
    object: usize,
}

/// Computes the times to collision of an evaluated object at the steps 1 to 80, in seconds. Its own validity
/// is not tested; that of the objects ahead is. Speeds next to invalid frames are as stored positions yield
/// them.
pub(super) fn times(motion: &Motion, object: usize) -> [f32; FUTURE] {
    let leaders = leaders(motion, object);
    std::array::from_fn(|k| {
        let Some(leader) = leaders[k] else { return MAX_TTC as f32 };
        let closing = f64::from(planar_speed(motion, object, k) - planar_speed(motion, leader.object, k));
        // Speeds are unknown at the last step.
        if closing > 0.0 { (leader.gap / closing).min(MAX_TTC) as f32 } else { MAX_TTC as f32 }
    })
}

fn leaders(motion: &Motion, object: usize) -> [Option<Leader>; FUTURE] {
    let (own, tracks) = (&motion.futures[object], &motion.tracks);
    let (half_length, half_width) = (tracks[object].length / 2.0, tracks[object].width / 2.0);
    let axes: [[f64; 2]; FUTURE] = std::array::from_fn(|k| {
        let (sin, cos) = math::sin_cos(f64::from(own.heading[k]));
        [cos, sin]
    });
    let (mut cos, mut sin) = ([0.0; FUTURE], [0.0; FUTURE]);
    for k in 0..FUTURE {
        (cos[k], sin[k]) = (axes[k][0] as f32, axes[k][1] as f32);
    }
    let mut leaders = [None; FUTURE];
    let mut is_near = [false; FUTURE];
    for other in (0..tracks.len()).filter(|&other| other != object) {
        let (theirs, track) = (&motion.futures[other], tracks[other]);
        let reach = (track.length * track.length + track.width * track.width).sqrt() / 2.0;
        let lateral_reach = half_width + reach + BOUND_SLACK;
        for k in 0..FUTURE {
            let (dx, dy) = (theirs.x[k] - own.x[k], theirs.y[k] - own.y[k]);
            let slack = RELATIVE_SLACK * (dx.abs() + dy.abs());
            is_near[k] = (theirs.heading[k] - own.heading[k]).abs() <= MAX_HEADING_DIFFERENCE
                && dx * cos[k] + dy * sin[k] + slack + BOUND_SLACK > half_length
                && (dy * cos[k] - dx * sin[k]).abs() < lateral_reach + slack;
        }
        for k in 0..FUTURE {
            if is_near[k]
                && motion.is_valid(other, k)
                && let Some(gap) = gap_ahead(motion, object, other, k, axes[k])
                && leaders[k].is_none_or(|leader: Leader| gap < leader.gap)
            {
                leaders[k] = Some(Leader { gap, object: other });
            }
        }
    }
    leaders
}

/// Returns the gap to another object along the heading if this object is ahead, in metres. `axis` is the
/// direction of the heading.
fn gap_ahead(motion: &Motion, object: usize, other: usize, step: usize, [cos, sin]: [f64; 2]) -> Option<f64> {
    let (own, theirs) = (&motion.futures[object], &motion.futures[other]);
    let half = |value: f32| f64::from(value) / 2.0;
    // The difference is not wrapped, as in the official code.
    let difference = (theirs.heading[step] - own.heading[step]).abs();
    let (sin_difference, cos_difference) = math::sin_cos(f64::from(difference));
    let (across, along) = (sin_difference.abs(), cos_difference.abs());
    let track = motion.tracks[other];
    let (half_length, half_width) = (half(track.length), half(track.width));
    let dx = f64::from(theirs.x[step]) - f64::from(own.x[step]);
    let dy = f64::from(theirs.y[step]) - f64::from(own.y[step]);
    let own_track = motion.tracks[object];
    let gap = dx * cos + dy * sin - half(own_track.length) - (half_length * along + half_width * across);
    let overlap =
        (dy * cos - dx * sin).abs() - half(own_track.width) - (half_length * across + half_width * along);
    let is_ahead = gap > 0.0
        && difference <= MAX_HEADING_DIFFERENCE
        && overlap < 0.0
        && (overlap < -SMALL_OVERLAP || difference <= SMALL_OVERLAP_HEADING_DIFFERENCE);
    is_ahead.then_some(gap)
}

/// Returns the times as [`times`] does, without the coarse test.
#[cfg(test)]
pub(super) fn times_to_all(motion: &Motion, object: usize) -> [f32; FUTURE] {
    std::array::from_fn(|k| {
        let (sin, cos) = math::sin_cos(f64::from(motion.futures[object].heading[k]));
        let others = (0..motion.tracks.len()).filter(|&other| other != object && motion.is_valid(other, k));
        let gaps = others.filter_map(|other| Some((gap_ahead(motion, object, other, k, [cos, sin])?, other)));
        let leader = gaps.reduce(|first, next| if next.0 < first.0 { next } else { first });
        let Some((gap, other)) = leader else { return MAX_TTC as f32 };
        let closing = f64::from(planar_speed(motion, object, k) - planar_speed(motion, other, k));
        if closing > 0.0 { (gap / closing).min(MAX_TTC) as f32 } else { MAX_TTC as f32 }
    })
}
