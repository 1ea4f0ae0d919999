//! Whether a file holds radians or degrees.

use super::raw::RawScenario;
use crate::geometry::{Vec2, direction, math};

/// From this speed on the direction of a velocity tells that of a vehicle, m/s.
const MOVING: f64 = 2.0;

/// What the headings of a file are to be multiplied with to be radians.
///
/// Nocturne wrote degrees, GPUDrive radians, and no file says which. Who moves goes where it heads: the unit holds in which headings
/// agree better with velocities. Where nobody moves, files with metadata are taken for GPUDrive's.
pub(super) fn per_unit(raw: &RawScenario) -> f64 {
    let degree = 1.0_f64.to_radians();
    let (mut radians, mut degrees) = (0.0, 0.0);
    for object in raw.objects.iter().filter(|o| o.kind != "pedestrian") {
        let frames = object.heading.iter().zip(&object.velocity).zip(&object.valid);
        for ((&heading, &velocity), _) in frames.filter(|(_, valid)| **valid) {
            let velocity = Vec2::from(velocity);
            let speed = math::hypot(velocity.x, velocity.y);
            if !(speed > MOVING && speed.is_finite() && heading.is_finite()) {
                continue;
            }
            radians += direction(heading).dot(&velocity) / speed;
            degrees += direction(heading * degree).dot(&velocity) / speed;
        }
    }
    let in_radians = if radians == degrees { raw.metadata.is_some() } else { radians > degrees };
    if in_radians { 1.0 } else { degree }
}
