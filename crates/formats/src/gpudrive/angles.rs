//! Detection of the angle unit of a file.

use reactsim_geometry::{Vec2, direction, math};

use super::raw::RawScenario;

/// Minimum speed in m/s at which the direction of the velocity is compared with the heading.
const MIN_SPEED: f64 = 2.0;

/// Returns the factor that converts the headings of a file to radians.
///
/// Nocturne wrote degrees, GPUDrive writes radians, and files do not state the unit. Since agents move in the
/// direction of their heading, the unit is the one in which headings agree better with velocities. If no
/// agent moves, files with metadata are taken for GPUDrive files.
pub(super) fn radians_per_unit(raw: &RawScenario) -> f64 {
    let degree = 1.0_f64.to_radians();
    let (mut radians, mut degrees) = (0.0, 0.0);
    for object in raw.objects.iter().filter(|o| o.kind != "pedestrian") {
        let frames = object.heading.iter().zip(&object.velocity).zip(&object.valid);
        for ((&heading, &velocity), _) in frames.filter(|(_, valid)| **valid) {
            let velocity = Vec2::from(velocity);
            let speed = math::hypot(velocity.x, velocity.y);
            if !(speed > MIN_SPEED && speed.is_finite() && heading.is_finite()) {
                continue;
            }
            radians += direction(heading).dot(&velocity) / speed;
            degrees += direction(heading * degree).dot(&velocity) / speed;
        }
    }
    let in_radians = if radians == degrees { raw.metadata.is_some() } else { radians > degrees };
    if in_radians { 1.0 } else { degree }
}
