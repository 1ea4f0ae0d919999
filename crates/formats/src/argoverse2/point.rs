//! Points of map archives.

use reactsim_geometry::Vec2;
use serde::Deserialize;

/// A point; old maps have no z.
#[derive(Clone, Copy, Deserialize)]
#[serde(expecting = "an object")]
pub(super) struct Point {
    pub(super) x: f64,
    pub(super) y: f64,
    pub(super) z: Option<f64>,
}

pub(super) fn points(line: &[Point]) -> Vec<Vec2> {
    line.iter().map(|p| Vec2::new(p.x, p.y)).collect()
}

/// Returns the height of each point, metres; NaN if unknown.
pub(super) fn heights(line: &[Point]) -> Vec<f64> {
    line.iter().map(|p| p.z.unwrap_or(f64::NAN)).collect()
}

/// Returns the ring around the area between two lines of the same direction.
pub(super) fn between(one: &[Point], other: &[Point]) -> Vec<Vec2> {
    let mut ring = points(one);
    ring.extend(points(other).into_iter().rev());
    ring
}
