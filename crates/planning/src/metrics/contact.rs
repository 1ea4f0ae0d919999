//! Contact of boxes, and objects ahead of and behind ego (nuPlan devkit 1.2.2).

use reactsim_geometry::{OrientedBox, direction};

use crate::{EgoState, TrackedObject};

/// Cosine of 30°, the largest angle at the rear axle between the heading of ego and an object ahead.
const AHEAD_COSINE: f64 = 0.866_025_403_784_438_6;
/// Cosine of 150°, the smallest angle between the heading of ego and an object behind.
const BEHIND_COSINE: f64 = -AHEAD_COSINE;

/// Returns whether two boxes are in contact. Touching boxes are.
pub(super) fn in_contact(a: &OrientedBox, b: &OrientedBox) -> bool {
    (b.center - a.center).norm() < a.radius() + b.radius() && a.separation(b) <= 0.0
}

/// The side of ego that an object is on, seen from the rear axle.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Side {
    /// Within 30° of the heading.
    Ahead,
    /// More than 150° from the heading.
    Behind,
    /// Between them, and an object whose centre is the rear axle.
    Lateral,
}

/// Returns the side of ego on which the centre of `object` is.
pub(super) fn side_of(ego: &EgoState, object: &TrackedObject) -> Side {
    let to_object = object.center - ego.rear_axle();
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
pub(super) fn moved(footprint: &OrientedBox, distance: f64) -> OrientedBox {
    OrientedBox { center: footprint.center + footprint.axis * distance, ..*footprint }
}
