//! The drivable ground: the union of surfaces, and the road edges around it.

use i_overlay::core::fill_rule::FillRule;
use i_overlay::core::overlay::{Overlay, ShapeType};
use i_overlay::core::overlay_rule::OverlayRule;
use i_overlay::i_float::int::point::IntPoint;

use crate::geometry::{Polygon, Vec2, point_segment};
use crate::scene::{RoadEdge, RoadEdgeKind};

/// Points of maps are multiples of this, metres: finer than any survey, and files stay small.
pub const GRID: f64 = 1.0 / 1024.0;

/// The point moved to the grid.
pub fn on_grid(p: Vec2) -> Vec2 {
    Vec2::new((p.x / GRID).round() * GRID, (p.y / GRID).round() * GRID)
}

/// Holes and islets smaller than this are slivers between surfaces, square metres.
const SLIVER: f64 = 2.0;

/// The union of rings, any orientation, less the union of `cut`. Exteriors run counter-clockwise, holes clockwise; all points lie on the grid,
/// and the arithmetic is whole numbers, so the result is the same everywhere.
pub fn union(rings: &[Vec<Vec2>], cut: &[Vec<Vec2>]) -> Vec<Polygon> {
    let mut overlay: Overlay<i32> = Overlay::new(rings.iter().chain(cut).map(Vec::len).sum());
    let mut contour = Vec::new();
    for (list, kind) in [(rings, ShapeType::Subject), (cut, ShapeType::Clip)] {
        for ring in list {
            contour.clear();
            contour.extend(
                ring.iter().map(|p| IntPoint::new((p.x / GRID).round() as i32, (p.y / GRID).round() as i32)),
            );
            // Nonzero winding adds up over rings, so all must turn the same way.
            if area(ring) < 0.0 {
                contour.reverse();
            }
            overlay.add_contour(&contour, kind);
        }
    }
    let back = |c: &[IntPoint<i32>]| -> Vec<Vec2> {
        c.iter().map(|p| Vec2::new(f64::from(p.x) * GRID, f64::from(p.y) * GRID)).collect()
    };
    let rule = if cut.is_empty() { OverlayRule::Subject } else { OverlayRule::Difference };
    let shapes = overlay.overlay(rule, FillRule::NonZero);
    let mut polygons = Vec::with_capacity(shapes.len());
    for shape in &shapes {
        let mut contours = shape.iter().map(|c| back(c)).filter(|c| area(c).abs() >= SLIVER);
        let Some(mut exterior) = contours.next() else { continue };
        let mut holes: Vec<Vec<Vec2>> = contours.collect();
        if area(&exterior) < 0.0 {
            exterior.reverse();
        }
        for hole in &mut holes {
            if area(hole) > 0.0 {
                hole.reverse();
            }
        }
        polygons.push(Polygon { exterior, holes });
    }
    polygons
}

/// The area of a ring, square metres, positive counter-clockwise.
pub fn area(ring: &[Vec2]) -> f64 {
    let Some(mut a) = ring.last().copied() else { return 0.0 };
    // Relative to a point of the ring, so that far rings lose no digits.
    let (o, mut sum) = (a, 0.0);
    for &b in ring {
        sum += (a - o).perp(&(b - o));
        a = b;
    }
    0.5 * sum
}

/// The rings of polygons as road edges: the drivable side lies on the left. Where a stretch of a ring lies on a gate, an end of a road
/// at the border of the map, there is no edge.
pub fn edges(polygons: &[Polygon], gates: &[(Vec2, Vec2)]) -> Vec<RoadEdge> {
    let mut out = Vec::new();
    for polygon in polygons {
        open(&polygon.exterior, gates, RoadEdgeKind::Boundary, &mut out);
        for hole in &polygon.holes {
            open(hole, gates, RoadEdgeKind::Median, &mut out);
        }
    }
    out
}

fn open(ring: &[Vec2], gates: &[(Vec2, Vec2)], kind: RoadEdgeKind, out: &mut Vec<RoadEdge>) {
    let n = ring.len();
    let near = |p: Vec2, a: Vec2, b: Vec2| point_segment(p, a, b).0 < 0.05 * 0.05;
    let shut: Vec<bool> = (0..n)
        .map(|i| gates.iter().any(|&(a, b)| near(ring[i], a, b) && near(ring[(i + 1) % n], a, b)))
        .collect();
    let Some(start) = shut.iter().position(|&s| s) else {
        let points = ring.iter().chain(ring.first()).copied().collect();
        out.push(RoadEdge { kind, points });
        return;
    };
    let mut points: Vec<Vec2> = Vec::new();
    for k in 1..=n {
        let i = (start + k) % n;
        points.push(ring[i]);
        if shut[i] {
            if points.len() > 1 {
                out.push(RoadEdge { kind, points: std::mem::take(&mut points) });
            }
            points.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rectangle(x: (f64, f64), y: (f64, f64)) -> Vec<Vec2> {
        vec![Vec2::new(x.0, y.0), Vec2::new(x.1, y.0), Vec2::new(x.1, y.1), Vec2::new(x.0, y.1)]
    }

    #[test]
    fn a_frame_has_a_hole() {
        let mut rings = vec![
            rectangle((0.0, 30.0), (0.0, 5.0)),
            rectangle((0.0, 30.0), (25.0, 30.0)),
            rectangle((0.0, 5.0), (0.0, 30.0)),
            rectangle((25.0, 30.0), (0.0, 30.0)),
        ];
        rings[1].reverse();
        let ground = union(&rings, &[]);
        assert_eq!((ground.len(), ground[0].holes.len()), (1, 1));
        assert_eq!((area(&ground[0].exterior), area(&ground[0].holes[0])), (900.0, -400.0));
        assert!(ground[0].contains(Vec2::new(2.0, 15.0)) && !ground[0].contains(Vec2::new(15.0, 15.0)));
        let kinds: Vec<_> = edges(&ground, &[]).iter().map(|e| e.kind).collect();
        assert_eq!(kinds, [RoadEdgeKind::Boundary, RoadEdgeKind::Median]);
    }

    #[test]
    fn what_is_cut_is_no_ground() {
        let ground = union(&[rectangle((0.0, 20.0), (0.0, 20.0))], &[rectangle((5.0, 9.0), (5.0, 9.0))]);
        assert_eq!((ground.len(), ground[0].holes.len()), (1, 1));
    }

    #[test]
    fn gates_have_no_edge() {
        let ground = union(&[rectangle((0.0, 50.0), (0.0, 8.0))], &[]);
        let gate = |x: f64| (Vec2::new(x, 0.0), Vec2::new(x, 8.0));
        let edges = edges(&ground, &[gate(0.0), gate(50.0)]);
        assert_eq!(edges.len(), 2);
        for edge in &edges {
            let along = edge.points[edge.points.len() - 1] - edge.points[0];
            // The drivable side is on the left: the lower edge runs to the right.
            assert_eq!(along.x > 0.0, edge.points[0].y == 0.0);
        }
    }
}
