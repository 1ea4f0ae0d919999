//! A spatial index of segments that follow one another along lines.

use super::{Bounds, Grid, Vec2};

/// Index over pieces of lines, each of a few successive segments.
#[derive(Clone, Debug)]
pub struct SegmentIndex {
    /// First segment of each piece; then the number of segments.
    pieces: Vec<u32>,
    bounds: Vec<Bounds>,
    grid: Grid,
}

/// Maximum number of segments of a piece.
const PIECE_SEGMENTS: u32 = 8;

impl SegmentIndex {
    /// Indexes segments, given by their ends, in cells of about `cell` metres.
    pub fn new(segments: impl IntoIterator<Item = [Vec2; 2]>, cell: f64) -> Self {
        let (mut pieces, mut bounds): (Vec<u32>, Vec<Bounds>) = (Vec::new(), Vec::new());
        let (mut count, mut end, mut length) = (0, None, 0.0);
        for [a, b] in segments {
            let last = pieces.last().copied().unwrap_or_default();
            if end != Some(a) || length >= cell || count - last == PIECE_SEGMENTS {
                pieces.push(count);
                bounds.push(Bounds::EMPTY);
                length = 0.0;
            }
            let piece = bounds.len() - 1;
            bounds[piece] = bounds[piece].union(&Bounds::of([a, b]));
            (count, end, length) = (count + 1, Some(b), length + (b - a).norm());
        }
        pieces.push(count);
        Self { grid: Grid::new(&bounds, cell), pieces, bounds }
    }

    /// Finds the segment nearest to `p` and its squared distance; the smallest index on ties. `None` if all
    /// are infinitely far away.
    ///
    /// `distance2` returns the squared distance of a segment, or infinity to leave it out. `start` is any
    /// segment to begin with, such as the answer for a nearby point; it shortens the search and never changes
    /// the answer.
    pub fn nearest(
        &self,
        p: Vec2,
        start: Option<u32>,
        distance2: impl FnMut(u32) -> f64,
    ) -> Option<(u32, f64)> {
        let mut nearest = (u32::MAX, f64::INFINITY);
        let start = start.map(|i| self.pieces.partition_point(|&first| first <= i) as u32 - 1);
        self.grid.nearest(p, start, self.of_pieces(p, &mut nearest, distance2));
        nearest.1.is_finite().then_some(nearest)
    }

    /// Finds the segment nearest to `p` within `radius` metres; the smallest index on ties. `distance2` as in
    /// [`Self::nearest`].
    pub fn nearest_within(&self, p: Vec2, radius: f64, distance2: impl FnMut(u32) -> f64) -> Option<u32> {
        let mut nearest = (u32::MAX, radius * radius);
        self.grid.nearest_within(p, radius, self.of_pieces(p, &mut nearest, distance2));
        (nearest.0 != u32::MAX).then_some(nearest.0)
    }

    /// Returns a function that returns the squared distance of a piece; infinity if it is farther than the
    /// nearest segment so far.
    fn of_pieces(
        &self,
        p: Vec2,
        nearest: &mut (u32, f64),
        mut distance2: impl FnMut(u32) -> f64,
    ) -> impl FnMut(u32) -> f64 {
        move |piece| {
            let piece = piece as usize;
            // The slack is larger than the error of the distances.
            if self.bounds[piece].distance2(p) > nearest.1 * (1.0 + 1e-9) + 1e-9 {
                return f64::INFINITY;
            }
            let mut least = f64::INFINITY;
            for i in self.pieces[piece]..self.pieces[piece + 1] {
                let d2 = distance2(i);
                least = least.min(d2);
                if d2 < nearest.1 || (d2 == nearest.1 && i < nearest.0) {
                    *nearest = (i, d2);
                }
            }
            least
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::point_segment;

    proptest! {
        #[test]
        fn the_nearest_segment_is_that_of_the_linear_scan(
            lines in prop::collection::vec(
                (
                    (-60.0..60.0_f64, -30.0..30.0_f64),
                    prop::collection::vec((-3.0..5.0_f64, -3.0..3.0_f64), 1..40),
                ),
                0..6,
            ),
            (x, y) in (-150.0..150.0_f64, -90.0..90.0_f64),
            start in any::<prop::sample::Index>(),
            left_out in 1..5_u32,
        ) {
            // Whole metres, so that there are ties.
            let whole = |(x, y): &(f64, f64)| Vec2::new(x.round(), y.round());
            let of_line = |(from, steps): &(_, Vec<(f64, f64)>)| {
                let ends = steps.iter().map(whole).scan(whole(from), |at, step| {
                    let from = *at;
                    *at += step;
                    Some([from, *at])
                });
                ends.collect::<Vec<_>>()
            };
            let segments: Vec<[Vec2; 2]> = lines.iter().flat_map(of_line).collect();
            let (index, p) = (SegmentIndex::new(segments.iter().copied(), 4.0), whole(&(x, y)));
            let d2 = |i: u32| {
                let [a, b] = segments[i as usize];
                if left_out > 1 && i.is_multiple_of(left_out) { f64::INFINITY } else { point_segment(p, a, b).0 }
            };
            let all = (0..segments.len() as u32).map(|i| (i, d2(i))).filter(|found| found.1.is_finite());
            let scan = all.reduce(|a, b| if b.1 < a.1 { b } else { a });
            let start = (!segments.is_empty()).then(|| start.index(segments.len()) as u32);
            prop_assert_eq!(index.nearest(p, None, d2), scan);
            prop_assert_eq!(index.nearest(p, start, d2), scan);
            let near = scan.filter(|found| found.1 <= 49.0).map(|found| found.0);
            prop_assert_eq!(index.nearest_within(p, 7.0, d2), near);
        }
    }
}
