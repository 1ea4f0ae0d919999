//! What is known of a pair: distance, bearing, heading difference.

use std::f32::consts::{PI, TAU};

use reactsim::geometry::math;

/// An angle as it enters the network, from -π to below π.
pub fn wrap(angle: f32) -> f32 {
    (angle + PI).rem_euclid(TAU) - PI
}

/// The signed angle from a heading, given as its cosine and sine, to a vector; 0 to no vector at all.
pub fn bearing([cos, sin]: [f64; 2], [x, y]: [f32; 2]) -> f32 {
    let (x, y) = (f64::from(x), f64::from(y));
    // Adding 0 turns -0 into 0: the angle of (-0, 0) would be π.
    math::atan2(cos * y - sin * x, cos * x + sin * y + 0.0) as f32
}

/// A place and a heading, with what is needed of it for every pair.
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

    /// The poses of these places and headings.
    pub(super) fn all(positions: &[[f32; 2]], headings: &[f32]) -> Vec<Self> {
        positions.iter().zip(headings).map(|(p, h)| Self::new(*p, *h)).collect()
    }

    /// Whether two are nearer than this, in f32 and without fused operations, as the published networks find it.
    pub(super) fn near(&self, other: &Self, radius: f32) -> bool {
        let (x, y) = (self.position[0] - other.position[0], self.position[1] - other.position[1]);
        x * x + y * y < radius * radius
    }

    /// How a source is seen from here: distance, bearing, heading difference (source minus own).
    pub(super) fn sees(&self, source: &Self) -> [f32; 3] {
        let offset = [source.position[0] - self.position[0], source.position[1] - self.position[1]];
        [norm(offset), bearing(self.direction, offset), wrap(source.heading - self.heading)]
    }

    /// How far and where to it moved from where it was: distance, bearing against the heading now.
    pub(super) fn motion(&self, before: [f32; 2]) -> [f32; 2] {
        let offset = [self.position[0] - before[0], self.position[1] - before[1]];
        [norm(offset), bearing(self.direction, offset)]
    }
}

fn norm([x, y]: [f32; 2]) -> f32 {
    (x * x + y * y).sqrt()
}
