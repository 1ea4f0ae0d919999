//! Boxes of objects in the plane.

use reactsim_geometry::math;
use reactsim_scene::wosac::WosacTrack;

/// Radius of rounded corners relative to half the shorter side.
const CORNER_ROUNDING: f32 = 0.7;

/// The size of an object with rounded corners: a core box, grown by a radius.
#[derive(Clone, Copy, Debug)]
pub(super) struct RoundedBox {
    /// Length of the core box, metres.
    core_length: f32,
    /// Width of the core box, metres.
    core_width: f32,
    /// Radius of the corners, metres.
    pub(super) radius: f32,
    /// Radius of the largest disc around the centre inside the shape, metres.
    pub(super) inner_radius: f32,
    /// Radius of the smallest disc around the centre that contains the shape, metres.
    pub(super) outer_radius: f32,
}

impl RoundedBox {
    pub(super) fn of(track: &WosacTrack) -> Self {
        let shorter = track.length.min(track.width);
        let radius = CORNER_ROUNDING * shorter / 2.0;
        let (core_length, core_width) = (track.length - 2.0 * radius, track.width - 2.0 * radius);
        let diagonal = (core_length * core_length + core_width * core_width).sqrt();
        Self {
            core_length,
            core_width,
            radius,
            inner_radius: shorter / 2.0,
            outer_radius: diagonal / 2.0 + radius,
        }
    }

    /// Returns the corners of the core box at a pose.
    pub(super) fn core_corners(&self, center: [f32; 2], heading: f32) -> [[f32; 2]; 4] {
        corners(center, heading, self.core_length, self.core_width)
    }
}

/// Returns the corners of a box, front left, rear left, rear right and front right, rounded to single
/// precision as in the official code.
pub(super) fn corners(center: [f32; 2], heading: f32, length: f32, width: f32) -> [[f32; 2]; 4] {
    let (sin, cos) = math::sin_cos(f64::from(heading));
    let (sin, cos) = (sin as f32, cos as f32);
    let (ahead, left) = (length / 2.0, width / 2.0);
    let corner = |dx: f32, dy: f32| [cos * dx - sin * dy + center[0], sin * dx + cos * dy + center[1]];
    [corner(ahead, left), corner(-ahead, left), corner(-ahead, -left), corner(ahead, -left)]
}
