//! Plane geometry: angles, oriented boxes, polylines, polygons and their union, oriented edges and a spatial
//! index.
//!
//! This module knows numbers only, not agents, lanes or scenarios. Units are metres and radians
//! (counter-clockwise); frames are right-handed.

mod angle;
mod edges;
mod grid;
pub mod math;
mod obb;
mod polygon;
mod polyline;
mod ring_index;
mod sweep;
mod union;

pub use angle::{direction, heading_of, into_frame, left, signed_angle_between, wrap};
pub use edges::{NearestEdge, OrientedEdges};
pub use grid::{Bounds, Grid, floor};
pub use obb::{OrientedBox, rounded_distance};

pub use polygon::{Polygon, point_in_ring, ring_distance};
pub use polyline::{Polyline, PolylineError, Projection};
pub use ring_index::{PolygonIndex, RingIndex};
pub use sweep::time_to_impact;
pub use union::{GRID_SPACING, on_grid, ring_area, union, union_of};

/// A point or a vector in the plane, in metres (or metres per second for velocities).
pub type Vec2 = nalgebra::Vector2<f64>;

/// Evaluates the fifth-order step from 0 to 1 over `u` in [0, 1]; first and second derivatives are 0 at both
/// ends.
pub fn smooth_step(u: f64) -> f64 {
    let u = u.clamp(0.0, 1.0);
    u * u * u * (10.0 + u * (6.0 * u - 15.0))
}

/// Returns the squared distance from `p` to the segment `a`-`b`, and the parameter of the nearest point,
/// clamped to
/// [0, 1].
#[inline]
pub fn point_segment(p: Vec2, a: Vec2, b: Vec2) -> (f64, f64) {
    let ab = b - a;
    let length2 = ab.norm_squared();
    let t = if length2 > 0.0 { (p - a).dot(&ab) / length2 } else { 0.0 };
    // End points are used exactly, so that two segments with a common end point are equally far from `p`.
    if t <= 0.0 {
        ((a - p).norm_squared(), 0.0)
    } else if t >= 1.0 {
        ((b - p).norm_squared(), 1.0)
    } else {
        ((a + ab * t - p).norm_squared(), t)
    }
}
