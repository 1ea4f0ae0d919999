//! Oriented road edges; their left side is drivable.

use super::{Bounds, Grid, Vec2, point_segment};

/// Oriented polylines that bound an area on their left, with an index over their segments.
#[derive(Clone, Debug)]
pub struct OrientedEdges {
    segments: Vec<Segment>,
    grid: Grid,
}

#[derive(Clone, Copy, Debug)]
struct Segment {
    a: Vec2,
    b: Vec2,
    previous: Option<u32>,
    next: Option<u32>,
}

/// The edge segment nearest to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestEdge {
    /// Index of the segment over all edges; a start for the next query nearby.
    pub segment: u32,
    /// Distance, metres.
    pub distance: f64,
    /// Whether the point is on the right, undrivable side. A point on the line counts as drivable.
    pub outside: bool,
}

/// Distance between the two ends, in metres, below which an edge is a closed ring (WOSAC's rule).
const CLOSED_GAP: f64 = 1.0;

impl OrientedEdges {
    /// Indexes `polylines`. Drops repeated points, and polylines of fewer than two distinct points.
    pub fn new<'a>(polylines: impl IntoIterator<Item = &'a [Vec2], IntoIter: Clone>) -> Self {
        let polylines = polylines.into_iter();
        let mut segments: Vec<Segment> = Vec::with_capacity(polylines.clone().map(<[Vec2]>::len).sum());
        for polyline in polylines {
            let first = segments.len() as u32;
            for pair in polyline.windows(2) {
                if pair[0] != pair[1] {
                    let i = segments.len() as u32;
                    segments.push(Segment {
                        a: pair[0],
                        b: pair[1],
                        previous: (i > first).then(|| i - 1),
                        next: Some(i + 1),
                    });
                }
            }
            let end = segments.len() as u32;
            if end == first {
                continue;
            }
            let last = end - 1;
            let closed = last > first && {
                let gap = segments[first as usize].a - segments[last as usize].b;
                gap.norm() < CLOSED_GAP
            };
            segments[last as usize].next = closed.then_some(first);
            segments[first as usize].previous = closed.then_some(last);
        }
        let bounds: Vec<Bounds> = segments.iter().map(|s| Bounds::of([s.a, s.b])).collect();
        Self { grid: Grid::new(&bounds, 4.0), segments }
    }

    /// Returns whether there are no edges.
    pub fn is_empty(&self) -> bool {
        self.segments.is_empty()
    }

    /// Finds the nearest segment and the side of it that `p` is on (for the off-road metric: WOSAC's rule in
    /// the plane).
    ///
    /// `start` is the segment found for a nearby point; it only shortens the search. `None` without edges.
    pub fn nearest(&self, p: Vec2, start: Option<u32>) -> Option<NearestEdge> {
        self.nearest_where(p, start, |_, _, _| true)
    }

    /// Like [`Self::nearest`], among the segments for which `keep` is true. It receives the index of the
    /// segment, the parameter of its point nearest to `p`, 0 to 1, and the squared distance of that point.
    /// `None` without such segments.
    pub fn nearest_where(
        &self,
        p: Vec2,
        start: Option<u32>,
        keep: impl Fn(u32, f64, f64) -> bool,
    ) -> Option<NearestEdge> {
        let distance2 = |i: u32| {
            let s = &self.segments[i as usize];
            let (d2, t) = point_segment(p, s.a, s.b);
            if keep(i, t, d2) { d2 } else { f64::INFINITY }
        };
        let (segment, d2) = self.grid.nearest(p, start, distance2).filter(|found| found.1.is_finite())?;
        Some(NearestEdge { segment, distance: d2.sqrt(), outside: self.outside(p, segment) })
    }

    fn outside(&self, p: Vec2, index: u32) -> bool {
        let s = &self.segments[index as usize];
        let d = s.b - s.a;
        let t = d.dot(&(p - s.a)) / d.norm_squared();
        let right_of = |s: &Segment| (s.b - s.a).perp(&(p - s.a)) < 0.0;
        let neighbour = if t < 0.0 {
            s.previous.map(|i| &self.segments[i as usize]).map(|before| (before, before, s))
        } else if t >= 1.0 {
            s.next.map(|i| &self.segments[i as usize]).map(|after| (after, s, after))
        } else {
            None
        };
        match neighbour {
            None => right_of(s),
            Some((other, before, after)) => {
                let left_turn = (before.b - before.a).perp(&(after.b - after.a)) > 0.0;
                if left_turn { right_of(s) || right_of(other) } else { right_of(s) && right_of(other) }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(edges: &OrientedEdges, x: f64, y: f64) -> bool {
        edges.nearest(Vec2::new(x, y), None).unwrap().outside
    }

    #[test]
    fn the_left_is_drivable() {
        let line = [Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0)];
        let edges = OrientedEdges::new([&line[..]]);
        assert!(!at(&edges, 5.0, 1.0));
        assert!(at(&edges, 5.0, -1.0));
        assert!(!at(&edges, 5.0, 0.0));
        assert!(at(&edges, 12.0, -0.1));
    }

    #[test]
    fn corners_combine_both_sides() {
        // A left turn at (10, 0): the tip on the outer side is off the road.
        let left = [Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(10.0, 10.0)];
        let edges = OrientedEdges::new([&left[..]]);
        assert!(at(&edges, 11.0, -1.0));
        assert!(!at(&edges, 9.0, 1.0));
        // A right turn at (10, 0): the outer side of the tip is on the road.
        let right = [Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(10.0, -10.0)];
        let edges = OrientedEdges::new([&right[..]]);
        assert!(!at(&edges, 11.0, 1.0));
        assert!(at(&edges, 9.0, -1.0));
    }

    #[test]
    fn no_edges_give_no_answer() {
        let one = [Vec2::new(0.0, 0.0)];
        let edges = OrientedEdges::new([&one[..]]);
        assert!(edges.is_empty());
        assert_eq!(edges.nearest(Vec2::zeros(), None), None);
    }
}
