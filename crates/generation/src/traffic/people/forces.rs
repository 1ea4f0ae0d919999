//! Interaction of people: the social force of Moussaïd et al. (2009).

use reactsim_geometry::{Vec2, left};

/// Strength of the interaction, m/s² (A, as published).
const STRENGTH: f64 = 4.5;
/// Range of the interaction per speed of approach, s (γ, as published).
const RANGE_TIME: f64 = 0.35;
/// Weight of the relative velocity against the direction to the other (λ, as published).
const FORESIGHT: f64 = 2.0;
/// Angular decay of the turning force (n, as published).
const ANGULAR_TURN: f64 = 2.0;
/// Angular decay of the slowing force (n', as published).
const ANGULAR_SLOW: f64 = 3.0;
/// Bias of the side on which people evade (ε, as published): to the right.
const SIDE_BIAS: f64 = 0.005;
/// Distance, metres, beyond which people do not influence each other.
pub(super) const INTERACTION_RANGE: f64 = 6.0;
/// Time in which people are willing to close up to the person in front, seconds.
const APPROACH_TIME: f64 = 0.7;

/// Returns `exp(-x)` for `x >= 0` by squaring: plain arithmetic, identical on every machine, within 3 %
/// where the result is above 0.02.
fn decay(x: f64) -> f64 {
    let mut power = 1.0 + x / 128.0;
    (0..7).for_each(|_| power *= power);
    1.0 / power
}

/// Returns the force on a person moving at `own` from a person at `d` (relative to the own position) moving
/// at `other`.
pub(super) fn interaction(d: Vec2, own: Vec2, other: Vec2) -> Vec2 {
    let distance = d.norm();
    let e = d / distance.max(1e-6);
    // A person who is neither near nor approaching has a negligible influence: skip the rest.
    if distance > 2.2 && (own - other).dot(&e) < 0.3 {
        return Vec2::zeros();
    }
    let approach = (own - other) * FORESIGHT + e;
    let strength = approach.norm();
    if strength < 1e-6 {
        return Vec2::zeros();
    }
    let t = approach / strength;
    let range = RANGE_TIME * strength;
    // Squared angle between the direction of approach and the direction to the other, as a series in 1 -
    // cos (within 5 % up to 115 degrees).
    let (cos, sin) = (t.dot(&e), t.perp(&e));
    let u = 1.0 - cos;
    let angle2 = u * (2.0 + u * (1.0 / 3.0 + u * (4.0 / 45.0 + u / 35.0)));
    let near = STRENGTH * decay(distance / range);
    if near < 0.02 {
        return Vec2::zeros();
    }
    let side = if sin + SIDE_BIAS * range >= 0.0 { 1.0 } else { -1.0 };
    let decays = |rate: f64| decay((rate * range) * (rate * range) * angle2);
    let (slow, turn) = (decays(ANGULAR_SLOW), decays(ANGULAR_TURN));
    (t * slow + left(t) * (side * turn)) * -near
}

/// Removes from `velocity` the part that would bring two bodies too close within [`APPROACH_TIME`] seconds;
/// `gap` is the distance left between them.
pub(super) fn limited_velocity(velocity: Vec2, d: Vec2, gap: f64, other: Vec2) -> Vec2 {
    let distance = d.norm();
    if distance < 1e-6 {
        return velocity;
    }
    let e = d / distance;
    // An approaching person is expected to give way as well; one who walks away makes room.
    let room = gap.max(0.0) / APPROACH_TIME + other.dot(&e).max(0.0);
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
