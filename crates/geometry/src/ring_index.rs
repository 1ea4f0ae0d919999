//! Fast containment tests for rings of many points.

use super::{Polygon, Vec2, point_segment};

/// Average number of ring edges per slab.
const EDGES_PER_SLAB: usize = 4;

/// Bound of the rounding errors of distances, metres.
const ROUNDING: f64 = 1e-6;

/// The edges of a ring, by horizontal slab: a point is tested against the edges of its slab only. The answers
/// equal those of [`super::point_in_ring`] on the whole ring.
#[derive(Clone, Debug)]
pub struct RingIndex {
    bottom: f64,
    top: f64,
    slabs_per_metre: f64,
    /// For each slab, the edges whose y range intersects it.
    slabs: Vec<Vec<(Vec2, Vec2)>>,
}

impl RingIndex {
    /// Builds the index of a ring, which may be open or closed.
    pub fn new(ring: &[Vec2]) -> Self {
        let (bottom, top) =
            ring.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), p| (a.min(p.y), b.max(p.y)));
        let count = (ring.len() / EDGES_PER_SLAB).max(1);
        let slabs_per_metre = if top > bottom { count as f64 / (top - bottom) } else { 0.0 };
        let mut index = Self { bottom, top, slabs_per_metre, slabs: vec![Vec::new(); count] };
        let mut a = ring.last().copied().unwrap_or_default();
        for &b in ring {
            let (first, last) = (index.slab(a.y.min(b.y)), index.slab(a.y.max(b.y)));
            index.slabs[first..=last].iter_mut().for_each(|slab| slab.push((a, b)));
            a = b;
        }
        index
    }

    /// Returns the slab of a y between bottom and top.
    fn slab(&self, y: f64) -> usize {
        (((y - self.bottom) * self.slabs_per_metre) as usize).min(self.slabs.len() - 1)
    }

    /// Returns whether `p` is inside the ring, like [`super::point_in_ring`].
    pub fn locate(&self, p: Vec2) -> Option<bool> {
        if self.bottom > self.top {
            return None;
        }
        if !(self.bottom <= p.y && p.y <= self.top) {
            return Some(false);
        }
        let mut inside = false;
        for &(a, b) in &self.slabs[self.slab(p.y)] {
            inside ^= super::polygon::crosses(p, a, b)?;
        }
        Some(inside)
    }

    /// Returns whether the ring is less than `distance` metres from `p`, by [`super::ring_distance`].
    pub fn is_within(&self, p: Vec2, distance: f64) -> bool {
        let reach = distance + ROUNDING;
        if self.bottom > self.top || p.y + reach < self.bottom || p.y - reach > self.top {
            return false;
        }
        let near = &self.slabs[self.slab(p.y - reach)..=self.slab(p.y + reach)];
        near.iter().flatten().any(|&(a, b)| point_segment(p, a, b).0.sqrt() < distance)
    }
}

/// An index of the rings of a polygon.
#[derive(Clone, Debug)]
pub struct PolygonIndex {
    exterior: RingIndex,
    holes: Vec<RingIndex>,
}

impl PolygonIndex {
    /// Builds the index of a polygon.
    pub fn new(polygon: &Polygon) -> Self {
        Self {
            exterior: RingIndex::new(&polygon.exterior),
            holes: polygon.holes.iter().map(|hole| RingIndex::new(hole)).collect(),
        }
    }

    /// Like [`Polygon::contains`].
    pub fn contains(&self, p: Vec2) -> bool {
        self.exterior.locate(p) == Some(true) && self.holes.iter().all(|hole| hole.locate(p) == Some(false))
    }

    /// Returns whether a ring is less than `distance` metres from `p`.
    pub fn is_boundary_within(&self, p: Vec2, distance: f64) -> bool {
        self.exterior.is_within(p, distance) || self.holes.iter().any(|hole| hole.is_within(p, distance))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{point_in_ring, ring_distance};

    fn points(max: usize) -> impl Strategy<Value = Vec<Vec2>> {
        // Whole numbers, so that points are often on edges, on corners or at the same y.
        prop::collection::vec((-6..6_i32, -6..6_i32), 0..max)
            .prop_map(|all| all.into_iter().map(|(x, y)| Vec2::new(f64::from(x), f64::from(y))).collect())
    }

    proptest! {
        #[test]
        fn the_index_agrees_with_the_ring(exterior in points(40), hole in points(12), queries in points(60)) {
            let polygon = Polygon { exterior, holes: vec![hole] };
            let index = PolygonIndex::new(&polygon);
            for p in queries {
                prop_assert_eq!(index.contains(p), polygon.contains(p), "{:?}", p);
                let between = p + Vec2::new(0.5, 0.25);
                prop_assert_eq!(index.contains(between), polygon.contains(between), "{:?}", between);
                let ring = RingIndex::new(&polygon.exterior);
                for p in [p, between] {
                    prop_assert_eq!(ring.locate(p), point_in_ring(p, &polygon.exterior), "{:?}", p);
                    let nearest = ring_distance(p, &polygon.exterior);
                    for distance in [0.0, 0.3, 2.0, nearest, nearest + 0.1] {
                        prop_assert_eq!(ring.is_within(p, distance), nearest < distance, "{:?} {}", p, distance);
                    }
                }
            }
        }
    }
}
