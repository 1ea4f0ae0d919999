//! Contact of boxes, and objects ahead of and behind ego (nuPlan devkit 1.2.2).

use reactsim_geometry::{OrientedBox, Vec2, direction};

use crate::EgoState;
use crate::metrics::ContactClass;

/// Cosine of 30°, the largest angle at the rear axle between the heading of ego and an object ahead.
const AHEAD_COSINE: f64 = 0.866_025_403_784_438_6;
/// Cosine of 150°, the smallest angle between the heading of ego and an object behind.
const BEHIND_COSINE: f64 = -AHEAD_COSINE;
/// Speed in m/s up to which ego or an object is stopped in a collision.
pub(crate) const STOPPED_SPEED: f64 = 0.05;

/// Returns whether two boxes are in contact. Touching boxes are.
pub(crate) fn in_contact(a: &OrientedBox, b: &OrientedBox) -> bool {
    (b.center - a.center).norm() < a.radius() + b.radius() && a.separation(b) <= 0.0
}

/// Returns the class of a contact of ego, whose box is `footprint`, with the box `other`. `is_stopped`: the
/// object is static or stopped.
pub(crate) fn classify(
    ego: &EgoState,
    footprint: &OrientedBox,
    other: &OrientedBox,
    is_stopped: bool,
) -> ContactClass {
    let [front_left, front_right, ..] = footprint.corners();
    if ego.speed() <= STOPPED_SPEED {
        ContactClass::StoppedEgo
    } else if is_stopped {
        ContactClass::StoppedTrack
    } else if side_of(ego, other.center) == Side::Behind {
        ContactClass::ActiveRear
    } else if other.intersects_segment(front_left, front_right) {
        ContactClass::ActiveFront
    } else {
        ContactClass::ActiveLateral
    }
}

/// The side of ego that an object is on, seen from the rear axle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Side {
    /// Within 30° of the heading.
    Ahead,
    /// More than 150° from the heading.
    Behind,
    /// Between them, or on the rear axle.
    Lateral,
}

/// Returns the side of ego on which the centre of an object is.
pub(crate) fn side_of(ego: &EgoState, center: Vec2) -> Side {
    let to_object = center - ego.rear_axle();
    let cosine = direction(ego.heading).dot(&to_object) / to_object.norm();
    if cosine > AHEAD_COSINE {
        Side::Ahead
    } else if cosine < BEHIND_COSINE {
        Side::Behind
    } else {
        Side::Lateral
    }
}

/// Returns the box after `distance` metres along its axis.
pub(crate) fn moved(footprint: &OrientedBox, distance: f64) -> OrientedBox {
    OrientedBox { center: footprint.center + footprint.axis * distance, ..*footprint }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sides_of_ego_end_at_30_and_150_degrees() {
        let ego = EgoState::standing(Vec2::new(3.0, -2.0), 0.7);
        let side_at = |degrees: f64| {
            side_of(&ego, ego.rear_axle() + direction(ego.heading + degrees.to_radians()) * 8.0)
        };
        for sign in [-1.0, 1.0] {
            assert_eq!([0.0, 29.9].map(|angle| side_at(sign * angle)), [Side::Ahead; 2]);
            assert_eq!([30.1, 90.0, 149.9].map(|angle| side_at(sign * angle)), [Side::Lateral; 3]);
            assert_eq!([150.1, 180.0].map(|angle| side_at(sign * angle)), [Side::Behind; 2]);
        }
        assert_eq!(side_of(&ego, ego.rear_axle()), Side::Lateral);
    }
}
