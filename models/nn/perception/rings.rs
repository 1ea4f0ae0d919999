//! Closed rings of the map, such as the edges of its drivable area.

use reactsim_geometry::{Polygon, Vec2, ring_area, union_of};
use reactsim_scene::RoadMap;

/// Returns the closed rings around the drivable area, with the area on their left, and whether each is a
/// hole. There are no rings where its polygons overlap or touch.
pub fn edge_rings(map: &RoadMap) -> Vec<(Vec<Vec2>, bool)> {
    let area = map.drivable_area.as_deref().unwrap_or_default();
    let merged = union_of(area).unwrap_or_else(|| area.to_vec());
    let rings = |p: &Polygon| {
        let holes = p.holes.iter().map(|hole| (oriented(hole, false), true));
        std::iter::once((oriented(&p.exterior, true), false)).chain(holes).collect::<Vec<_>>()
    };
    merged.iter().flat_map(rings).collect()
}

/// Returns a ring that ends at its first point.
pub fn closed(ring: &[Vec2]) -> Vec<Vec2> {
    let mut ring = ring.to_vec();
    if let Some(&first) = ring.first()
        && ring.last() != Some(&first)
    {
        ring.push(first);
    }
    ring
}

/// Returns a closed ring that runs counter-clockwise, or clockwise.
fn oriented(ring: &[Vec2], counter_clockwise: bool) -> Vec<Vec2> {
    let mut ring = closed(ring);
    if (ring_area(&ring) > 0.0) != counter_clockwise {
        ring.reverse();
    }
    ring
}
