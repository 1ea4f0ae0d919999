//! Detection of the angle unit of a file.

use reactsim_geometry::{Vec2, direction};

use super::raw::RawScenario;

/// Minimum displacement in metres from one frame to the next whose direction is compared with the heading: 2
/// m/s.
const MIN_DISPLACEMENT: f64 = 0.2;

/// Returns the factor that converts the headings of a file to radians.
///
/// Nocturne wrote degrees, GPUDrive writes radians, and files do not state the unit. Since agents move in the
/// direction of their heading, the unit is the one in which headings agree better with displacements;
/// velocities may be in another frame. If no agent moves, files with metadata are taken for GPUDrive files.
pub(super) fn radians_per_unit(raw: &RawScenario) -> f64 {
    let degree = 1.0_f64.to_radians();
    let (mut radians, mut degrees) = (0.0, 0.0);
    for object in raw.objects.iter().filter(|o| o.kind != "pedestrian") {
        let frames = object.heading.iter().zip(object.position.windows(2)).zip(object.valid.windows(2));
        for ((&heading, pair), _) in frames.filter(|(_, valid)| **valid == [true, true]) {
            let way = Vec2::from(pair[1]) - Vec2::from(pair[0]);
            let length = way.norm();
            if !(length > MIN_DISPLACEMENT && length.is_finite() && heading.is_finite()) {
                continue;
            }
            radians += direction(heading).dot(&way) / length;
            degrees += direction(heading * degree).dot(&way) / length;
        }
    }
    let in_radians = if radians == degrees { raw.metadata.is_some() } else { radians > degrees };
    if in_radians { 1.0 } else { degree }
}
