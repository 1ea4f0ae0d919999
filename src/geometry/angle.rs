//! Angles in radians, counter-clockwise.

use std::f64::consts::{PI, TAU};

use super::{Vec2, math};

/// Wraps an angle to [-pi, pi): `((a + pi) mod 2 pi) - pi` with the mathematical modulo. Not finite in, NaN out.
pub fn wrap(angle: f64) -> f64 {
    if (-PI..PI).contains(&angle) { angle } else { (angle + PI).rem_euclid(TAU) - PI }
}

/// The unit vector that points along `heading`.
pub fn direction(heading: f64) -> Vec2 {
    let (sin, cos) = math::sin_cos(heading);
    Vec2::new(cos, sin)
}

/// Where `v` points, radians, in [-pi, pi]: the inverse of [`direction`]. The zero vector gives 0.
pub fn heading_of(v: Vec2) -> f64 {
    math::atan2(v.y, v.x)
}

/// `v` turned left by a quarter of a circle.
pub fn left(v: Vec2) -> Vec2 {
    Vec2::new(-v.y, v.x)
}

/// The vector `v` in the frame whose x axis is `ahead` (unit) and whose y axis is to the left of it.
pub fn into_frame(ahead: Vec2, v: Vec2) -> Vec2 {
    Vec2::new(ahead.dot(&v), left(ahead).dot(&v))
}

/// The signed angle from `a` to `b`, in (-pi, pi]; positive is counter-clockwise. Zero vectors give 0.
pub fn signed_angle_between(a: Vec2, b: Vec2) -> f64 {
    math::atan2(a.perp(&b), a.dot(&b))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn wraps_into_the_half_open_interval() {
        assert_eq!(wrap(PI), -PI);
        assert_eq!(wrap(-PI), -PI);
        assert!((wrap(17.3) - (17.3 - 3.0 * TAU)).abs() < 1e-12);
        assert!(wrap(f64::NAN).is_nan());
    }
}
