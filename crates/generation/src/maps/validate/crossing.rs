//! Crossings of segments.

use reactsim_geometry::Vec2;

use crate::maps::build::cross;

/// A segment of a line, with the number of the line.
#[derive(Clone, Copy, Debug)]
pub(super) struct Piece {
    pub(super) a: Vec2,
    pub(super) b: Vec2,
    pub(super) id: usize,
}

/// Returns the first crossing of two pieces that `apart` allows to be compared, found by a sweep along the
/// longer side.
pub(super) fn first_crossing(pieces: &[Piece], apart: impl Fn(usize, usize) -> bool) -> Option<Vec2> {
    let bounds = reactsim_geometry::Bounds::of(pieces.iter().flat_map(|p| [p.a, p.b]));
    let extent = bounds.max - bounds.min;
    let (main, other) = if extent.x >= extent.y { (0, 1) } else { (1, 0) };
    let span = |p: &Piece, axis: usize| (p.a[axis].min(p.b[axis]), p.a[axis].max(p.b[axis]));
    let mut order: Vec<(f64, usize)> = pieces.iter().enumerate().map(|(i, p)| (span(p, main).0, i)).collect();
    order.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    for (k, &(_, i)) in order.iter().enumerate() {
        let (end, (low, high)) = (span(&pieces[i], main).1, span(&pieces[i], other));
        for &(start, j) in &order[k + 1..] {
            if start > end {
                break;
            }
            let (p, q) = (&pieces[i], &pieces[j]);
            let (from, to) = span(q, other);
            if from > high || to < low || !apart(p.id, q.id) {
                continue;
            }
            if let Some(at) = cross(p.a, p.b, q.a, q.b) {
                return Some(at);
            }
        }
    }
    None
}

/// Returns the ring without a closing point and without repeated points.
pub(super) fn open_ring(ring: &[Vec2]) -> Vec<Vec2> {
    let mut points: Vec<Vec2> = Vec::with_capacity(ring.len());
    for &p in ring {
        if points.last() != Some(&p) {
            points.push(p);
        }
    }
    if points.len() > 1 && points.first() == points.last() {
        points.pop();
    }
    points
}
