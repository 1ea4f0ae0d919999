//! The drivable ground: the union of surfaces, and the road edges around it.

pub use reactsim_geometry::{GRID_SPACING, on_grid, ring_area as area, union};
use reactsim_geometry::{Polygon, Vec2, point_segment};
use reactsim_scene::{RoadEdge, RoadEdgeKind};

/// Converts the rings of polygons to road edges with the drivable side on the left. There is no edge where
/// a stretch of a ring is on a gate, an end of a road at the border of the map.
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
