//! Points of map archives.

use reactsim_geometry::Vec2;
use serde::Deserialize;

/// A point; its z coordinate is not read.
#[derive(Clone, Copy, Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
}

pub(super) fn points(line: &[Point]) -> Vec<Vec2> {
    line.iter().map(|p| Vec2::new(p.x, p.y)).collect()
}

/// Returns the ring around the area between two lines of the same direction.
pub(super) fn between(one: &[Point], other: &[Point]) -> Vec<Vec2> {
    let mut ring = points(one);
    ring.extend(points(other).into_iter().rev());
    ring
}
