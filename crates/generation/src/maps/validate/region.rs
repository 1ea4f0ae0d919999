//! Regions that are queried with many points.

use reactsim_geometry::{Bounds, Vec2, point_segment};

/// The interior of some rings (even-odd rule), indexed in rows.
pub(super) struct Region {
    edges: Vec<(Vec2, Vec2)>,
    pub(super) bounds: Bounds,
    per_row: f64,
    starts: Vec<u32>,
    items: Vec<u32>,
}

/// Maximum number of rows.
const MAX_ROWS: usize = 256;

impl Region {
    pub(super) fn new<'a>(rings: impl IntoIterator<Item = &'a [Vec2]>) -> Self {
        let mut edges = Vec::new();
        for ring in rings {
            for (i, &b) in ring.iter().enumerate() {
                let a = ring[(i + ring.len() - 1) % ring.len()];
                if a != b {
                    edges.push((a, b));
                }
            }
        }
        let bounds = Bounds::of(edges.iter().map(|e| e.0));
        let rows = (edges.len() / 2).clamp(1, MAX_ROWS);
        let per_row = rows as f64 / (bounds.max.y - bounds.min.y).max(1e-9);
        let mut region = Self { edges, bounds, per_row, starts: vec![0; rows + 1], items: Vec::new() };
        for i in 0..region.edges.len() {
            let (first, last) = region.rows_of(i);
            region.starts[first + 1..=last + 1].iter_mut().for_each(|n| *n += 1);
        }
        for row in 0..rows {
            region.starts[row + 1] += region.starts[row];
        }
        let mut next = region.starts.clone();
        region.items = vec![0; region.starts[rows] as usize];
        for i in 0..region.edges.len() {
            let (first, last) = region.rows_of(i);
            for at in &mut next[first..=last] {
                region.items[*at as usize] = i as u32;
                *at += 1;
            }
        }
        region
    }

    fn row(&self, y: f64) -> usize {
        let last = self.starts.len() - 2;
        (((y - self.bounds.min.y) * self.per_row).max(0.0) as usize).min(last)
    }

    fn rows_of(&self, edge: usize) -> (usize, usize) {
        let (a, b) = self.edges[edge];
        (self.row(a.y.min(b.y)), self.row(a.y.max(b.y)))
    }

    fn in_rows(&self, first: usize, last: usize) -> impl Iterator<Item = &(Vec2, Vec2)> {
        let items = self.starts[first] as usize..self.starts[last + 1] as usize;
        self.items[items].iter().map(|&i| &self.edges[i as usize])
    }

    pub(super) fn contains(&self, p: Vec2) -> bool {
        if !self.bounds.contains(p) {
            return false;
        }
        let row = self.row(p.y);
        let crossed = self
            .in_rows(row, row)
            .filter(|(a, b)| (a.y > p.y) != (b.y > p.y) && ((b - a).perp(&(p - a)) > 0.0) == (b.y > a.y));
        crossed.count() % 2 == 1
    }

    /// Whether the border passes within this many metres of a point.
    pub(super) fn border_within(&self, p: Vec2, distance: f64) -> bool {
        if self.edges.is_empty() || !self.bounds.inflated(distance).contains(p) {
            return false;
        }
        let (first, last) = (self.row(p.y - distance), self.row(p.y + distance));
        self.in_rows(first, last).any(|&(a, b)| point_segment(p, a, b).0 <= distance * distance)
    }

    /// Returns the distance to the border, metres.
    pub(super) fn border_distance(&self, p: Vec2) -> f64 {
        let nearest = self.edges.iter().map(|&(a, b)| point_segment(p, a, b).0).fold(f64::INFINITY, f64::min);
        nearest.sqrt()
    }

    /// Whether a point is inside and at least this far from the border.
    pub(super) fn holds(&self, p: Vec2, depth: f64) -> bool {
        self.contains(p) && !self.border_within(p, depth)
    }
}
