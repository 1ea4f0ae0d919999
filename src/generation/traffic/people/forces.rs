//! What people do to one another: the social force of Moussaïd et al. (2009).

use crate::geometry::{Vec2, left};

/// Strength, m/s²; range per speed of approach, s; weights of relative velocity and of direction, as published.
const STRENGTH: f64 = 4.5;
const RANGE: f64 = 0.35;
const FORESIGHT: f64 = 2.0;
const ANGULAR_TURN: f64 = 2.0;
const ANGULAR_SLOW: f64 = 3.0;
/// Bias of the side on which people evade, as published: to the right.
const BIAS: f64 = 0.005;
/// Farther than this nobody matters, metres.
pub(super) const REACH: f64 = 6.0;
/// Time in which people are willing to come up to who is in front of them, seconds.
const APPROACH: f64 = 0.7;

/// `exp(-x)` for x of at least 0, by squaring: plain arithmetic, the same on every machine; within 3 % where it is above 0.02.
fn decay(x: f64) -> f64 {
    let mut power = 1.0 + x / 128.0;
    (0..7).for_each(|_| power *= power);
    1.0 / power
}

/// The force of somebody at `d` (from the own position), who moves at `other`, on who moves at `own`.
pub(super) fn interaction(d: Vec2, own: Vec2, other: Vec2) -> Vec2 {
    let distance = d.norm();
    let e = d / distance.max(1e-6);
    // Who is neither near nor comes nearer has next to no weight: spares the rest.
    if distance > 2.2 && (own - other).dot(&e) < 0.3 {
        return Vec2::zeros();
    }
    let approach = (own - other) * FORESIGHT + e;
    let strength = approach.norm();
    if strength < 1e-6 {
        return Vec2::zeros();
    }
    let t = approach / strength;
    let range = RANGE * strength;
    // The angle from the direction of approach to the other one, squared, as a series in 1 - cos (within 5 % up to 115 degrees).
    let (cos, sin) = (t.dot(&e), t.perp(&e));
    let u = 1.0 - cos;
    let angle2 = u * (2.0 + u * (1.0 / 3.0 + u * (4.0 / 45.0 + u / 35.0)));
    let near = STRENGTH * decay(distance / range);
    if near < 0.02 {
        return Vec2::zeros();
    }
    let side = if sin + BIAS * range >= 0.0 { 1.0 } else { -1.0 };
    let decays = |rate: f64| decay((rate * range) * (rate * range) * angle2);
    let (slow, turn) = (decays(ANGULAR_SLOW), decays(ANGULAR_TURN));
    (t * slow + left(t) * (side * turn)) * -near
}

/// Takes out of `velocity` what would bring two bodies too near within [`APPROACH`] seconds; `gap` is what is left between them.
pub(super) fn held(velocity: Vec2, d: Vec2, gap: f64, other: Vec2) -> Vec2 {
    let distance = d.norm();
    if distance < 1e-6 {
        return velocity;
    }
    let e = d / distance;
    // Who comes on is expected to give way as well; who walks away makes room.
    let room = gap.max(0.0) / APPROACH + other.dot(&e).max(0.0);
    velocity - e * (velocity.dot(&e) - room).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn decay_is_near_the_exponential() {
        for x in [0.0, 0.3, 1.0, 2.0, 3.5] {
            assert!((decay(x) / f64::exp(-x) - 1.0).abs() < 0.05, "{x}");
        }
    }

    #[test]
    fn people_who_meet_head_on_slow_down_and_evade_to_the_right() {
        let force = interaction(Vec2::new(3.0, 0.0), Vec2::new(1.3, 0.0), Vec2::new(-1.3, 0.0));
        assert!(force.x < 0.0 && force.y < 0.0, "{force}");
        let away = interaction(Vec2::new(-3.0, 0.0), Vec2::new(1.3, 0.0), Vec2::new(1.3, 0.0));
        assert!(away.norm() < 0.01, "{away}");
    }
}
