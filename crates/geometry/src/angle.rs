//! Angles in radians, counter-clockwise.

use std::f64::consts::{PI, TAU};

use super::{Vec2, math};

/// Wraps an angle to [-pi, pi): `((a + pi) mod 2 pi) - pi` with the mathematical modulo. NaN if not finite.
#[inline]
pub fn wrap(angle: f64) -> f64 {
    if (-PI..PI).contains(&angle) { angle } else { (angle + PI).rem_euclid(TAU) - PI }
}

/// Returns the unit vector along `heading`.
#[inline]
pub fn direction(heading: f64) -> Vec2 {
    let (sin, cos) = math::sin_cos(heading);
    Vec2::new(cos, sin)
}

/// Returns the heading of `v`, radians, in [-pi, pi]: the inverse of [`direction`]. The zero vector gives 0.
#[inline]
pub fn heading_of(v: Vec2) -> f64 {
    math::atan2(v.y, v.x)
}

/// Returns `v` rotated counter-clockwise by a quarter turn.
#[inline]
pub fn left(v: Vec2) -> Vec2 {
    Vec2::new(-v.y, v.x)
}

/// Returns `v` in the frame whose x axis is `ahead` (a unit vector) and whose y axis points to its left.
#[inline]
pub fn into_frame(ahead: Vec2, v: Vec2) -> Vec2 {
    Vec2::new(ahead.dot(&v), left(ahead).dot(&v))
}

/// Returns the signed angle from `a` to `b`, in (-pi, pi]; positive is counter-clockwise. Zero vectors give
/// 0.
#[inline]
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
