//! Relation of two poses: distance, bearing, heading difference.

use std::f32::consts::{PI, TAU};

use reactsim_geometry::math;

/// Wraps an angle to the range from -π to below π, as the network expects.
pub fn wrap(angle: f32) -> f32 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// Returns the signed angle from a heading, given as cosine and sine, to a vector; 0 for the zero
/// vector.
pub fn bearing([cos, sin]: [f64; 2], [x, y]: [f32; 2]) -> f32 {
    let (x, y) = (f64::from(x), f64::from(y));
    // Adding 0 turns -0 into 0: the angle of (-0, 0) would be π.
    math::atan2(cos * y - sin * x, cos * x + sin * y + 0.0) as f32
}

/// A position and heading, with the direction precomputed for relations.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) position: [f32; 2],
    heading: f32,
    direction: [f64; 2],
}

impl Pose {
    pub(super) fn new(position: [f32; 2], heading: f32) -> Self {
        let (sin, cos) = math::sin_cos(f64::from(heading));
        Self { position, heading, direction: [cos, sin] }
    }

    /// Builds poses from positions and headings.
    pub(super) fn all(positions: &[[f32; 2]], headings: &[f32]) -> Vec<Self> {
        positions.iter().zip(headings).map(|(p, h)| Self::new(*p, *h)).collect()
    }

    /// Returns whether two poses are less than `radius` apart, computed in f32 without fused operations,
    /// as in the published networks.
    pub(super) fn is_within(&self, other: &Self, radius: f32) -> bool {
        let (x, y) = (self.position[0] - other.position[0], self.position[1] - other.position[1]);
        x * x + y * y < radius * radius
    }

    /// Returns the relation to a source: distance, bearing, heading difference (source minus own).
    pub(super) fn relation_to(&self, source: &Self) -> [f32; 3] {
        let offset = [source.position[0] - self.position[0], source.position[1] - self.position[1]];
        [norm(offset), bearing(self.direction, offset), wrap(source.heading - self.heading)]
    }

    /// Returns the displacement from the position `before`: distance, and bearing relative to the
    /// present heading.
    pub(super) fn motion(&self, before: [f32; 2]) -> [f32; 2] {
        let offset = [self.position[0] - before[0], self.position[1] - before[1]];
        [norm(offset), bearing(self.direction, offset)]
    }
}

fn norm([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}
