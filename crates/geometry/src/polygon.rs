//! Polygons with holes.

use super::{Vec2, grid::Bounds, point_segment};

/// A polygon with holes. Rings may be open or closed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Polygon {
    /// The outer ring.
    pub exterior: Vec<Vec2>,
    /// Rings that are cut out.
    pub holes: Vec<Vec<Vec2>>,
}

impl Polygon {
    /// Returns whether `p` is strictly inside: within the exterior, outside every hole, on no boundary (GEOS
    /// `contains`).
    pub fn contains(&self, p: Vec2) -> bool {
        point_in_ring(p, &self.exterior) == Some(true)
            && self.holes.iter().all(|hole| point_in_ring(p, hole) == Some(false))
    }

    /// Returns the axis-aligned bounds of the exterior.
    pub fn bounds(&self) -> Bounds {
        Bounds::of(self.exterior.iter().copied())
    }
}

/// Returns whether `p` is inside the ring (even-odd rule); `None` on the boundary. The ring may be open or
/// closed.
pub fn point_in_ring(p: Vec2, ring: &[Vec2]) -> Option<bool> {
    let mut inside = false;
    let mut a = *ring.last()?;
    let mut a_is_above = a.y > p.y;
    for &b in ring {
        let b_is_above = b.y > p.y;
        // All other edges are above or below: neither crossed nor met.
        if a_is_above != b_is_above || b.y == p.y {
            inside ^= crosses(p, a, b)?;
        }
        (a, a_is_above) = (b, b_is_above);
    }
    Some(inside)
}

/// Returns whether a ray from `p` along the x axis crosses the edge from `a` to `b`; `None` if `p` is on the
/// edge.
pub(super) fn crosses(p: Vec2, a: Vec2, b: Vec2) -> Option<bool> {
    if (a.y > p.y) != (b.y > p.y) {
        let side = (b - a).perp(&(p - a));
        return if side == 0.0 { None } else { Some((side > 0.0) == (b.y > a.y)) };
    }
    let on_edge = a.y == p.y && b.y == p.y && a.x.min(b.x) <= p.x && p.x <= a.x.max(b.x);
    if on_edge || b == p { None } else { Some(false) }
}

/// Returns the distance from `p` to the boundary of a ring, metres; infinite for an empty ring.
pub fn ring_distance(p: Vec2, ring: &[Vec2]) -> f64 {
    let Some(mut a) = ring.last().copied() else { return f64::INFINITY };
    let mut best = f64::INFINITY;
    for &b in ring {
        best = best.min(point_segment(p, a, b).0);
        a = b;
    }
    best.sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn square(lo: f64, hi: f64) -> Vec<Vec2> {
        vec![Vec2::new(lo, lo), Vec2::new(hi, lo), Vec2::new(hi, hi), Vec2::new(lo, hi)]
    }

    #[test]
    fn boundary_is_outside_and_holes_are_cut_out() {
        let p = Polygon { exterior: square(0.0, 10.0), holes: vec![square(4.0, 6.0)] };
        assert!(p.contains(Vec2::new(1.0, 1.0)));
        for outside in [(0.0, 5.0), (10.0, 10.0), (5.0, 10.0), (5.0, 5.0), (4.0, 5.0), (11.0, 5.0)] {
            assert!(!p.contains(Vec2::new(outside.0, outside.1)), "{outside:?}");
        }
        assert_eq!(ring_distance(Vec2::new(13.0, 14.0), &p.exterior), 5.0);
        assert_eq!(ring_distance(Vec2::new(5.0, 5.0), &p.holes[0]), 1.0);
    }

    #[test]
    fn closed_and_open_rings_agree() {
        let mut closed = square(0.0, 1.0);
        closed.push(closed[0]);
        for p in [Vec2::new(0.5, 0.5), Vec2::new(0.0, 0.5), Vec2::new(2.0, 0.5), Vec2::new(0.5, 0.0)] {
            assert_eq!(point_in_ring(p, &closed), point_in_ring(p, &square(0.0, 1.0)));
        }
    }
}
