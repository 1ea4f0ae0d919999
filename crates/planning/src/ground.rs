//! Ground that vehicles cover on paths: boxes, outlines and strips, their contact and their distances.

use std::f64::consts::{FRAC_PI_2, TAU};

use reactsim_geometry::{Bounds, OrientedBox, Vec2, direction, heading_of, left};

use crate::shapes::{CHUNK, chunk_bounds, segments};

/// Angle in radians of a segment of a round join: 16 segments per quarter turn (Shapely 2.0, `buffer`).
const JOIN_ANGLE: f64 = FRAC_PI_2 / 16.0;
/// Distance, in half-widths, up to which the ends of two sides at a bend are one point (GEOS 3.11,
/// `OffsetSegmentGenerator`).
const SAME_END: f64 = 1e-3;
/// Distance, in half-widths, up to which a point of an outline is left out (GEOS 3.11,
/// `OffsetSegmentGenerator`).
const SAME_POINT: f64 = 1e-4;
/// Share of the half-width, as 1 to this number, by which the outline turns inwards at the inside of a bend
/// whose segments are too short to meet (GEOS 3.11, `OffsetSegmentGenerator`).
const INWARDS: f64 = 80.0;

/// Ground: the union of rings. A ring encloses the points around which it winds.
#[derive(Clone, Debug)]
pub(crate) struct Ground {
    rings: Vec<Ring>,
    bounds: Bounds,
}

/// A closed line, whose last point is the first one.
#[derive(Clone, Debug)]
struct Ring {
    points: Vec<Vec2>,
    /// Bounds of each [`CHUNK`] segments.
    chunks: Vec<Bounds>,
    bounds: Bounds,
}

impl Ground {
    /// Returns the ground of a box.
    pub(crate) fn of_box(footprint: &OrientedBox) -> Self {
        Self::inside(footprint.corners().to_vec())
    }

    /// Returns the ground inside a ring, open or closed. Two points are the ground of a line.
    pub(crate) fn inside(points: Vec<Vec2>) -> Self {
        let ring = Ring::new(points);
        Self { bounds: ring.bounds, rings: vec![ring] }
    }

    /// Returns the ground within `half_width` metres of a line, with flat ends and round joins. Joins are
    /// chords as in GEOS, whose deviation from an arc is up to 1e-3 m in a bend.
    pub(crate) fn along(points: &[Vec2], half_width: f64) -> Self {
        let mut outline = Outline { points: Vec::new(), half_width };
        let mut line = points.to_vec();
        line.dedup();
        for _ in 0..2 {
            outline.add_side(&line);
            line.reverse();
        }
        Self::inside(outline.points)
    }

    /// Returns the union of two grounds.
    pub(crate) fn with(mut self, other: Self) -> Self {
        self.bounds = self.bounds.union(&other.bounds);
        self.rings.extend(other.rings);
        self
    }

    /// Returns the middle of the axis-aligned bounds.
    pub(crate) fn middle(&self) -> Vec2 {
        (self.bounds.min + self.bounds.max) * 0.5
    }

    pub(crate) fn touches(&self, other: &Self) -> bool {
        self.bounds.intersects(&other.bounds)
            && self.rings.iter().any(|a| other.rings.iter().any(|b| a.touches(b)))
    }

    /// Returns the distance of two grounds, metres; 0 if they touch or overlap.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        if self.touches(other) {
            return 0.0;
        }
        let pairs = self.rings.iter().flat_map(|a| other.rings.iter().map(move |b| (a, b)));
        pairs.fold(f64::INFINITY, |least, (a, b)| a.distance2_below(b, least)).sqrt()
    }
}

impl Ring {
    fn new(mut points: Vec<Vec2>) -> Self {
        if points.first() != points.last() {
            points.extend(points.first().copied());
        }
        Self { chunks: chunk_bounds(&points, 0.0), bounds: Bounds::of(points.iter().copied()), points }
    }

    fn touches(&self, other: &Self) -> bool {
        self.bounds.intersects(&other.bounds)
            && (self.meets(other) || self.encloses(other.points[0]) || other.encloses(self.points[0]))
    }

    /// Returns whether the lines of two rings have a common point.
    fn meets(&self, other: &Self) -> bool {
        let near = |own: &Bounds| own.intersects(&other.bounds);
        let mut own = self.chunks.iter().enumerate().filter(|(_, own)| near(own));
        own.any(|(i, own)| {
            let mut theirs = other.chunks.iter().enumerate().filter(|(_, theirs)| own.intersects(theirs));
            theirs.any(|(j, _)| self.chunk(i).any(|a| other.chunk(j).any(|b| meet(a, b))))
        })
    }

    /// Returns whether the ring winds around a point that is not on it.
    fn encloses(&self, p: Vec2) -> bool {
        let mut turns = 0;
        for pair in self.points.windows(2) {
            let (a, b) = (pair[0], pair[1]);
            if (a.y <= p.y) != (b.y <= p.y) {
                let side = (b - a).perp(&(p - a));
                turns += i32::from(b.y > a.y && side > 0.0) - i32::from(b.y < a.y && side < 0.0);
            }
        }
        turns != 0
    }

    /// Returns the squared distance of the lines of two rings, m²; `bound` if it is not below it.
    fn distance2_below(&self, other: &Self, bound: f64) -> f64 {
        let mut least = bound;
        for (i, own) in self.chunks.iter().enumerate() {
            if distance2(own, &other.bounds) >= least {
                continue;
            }
            for (j, theirs) in other.chunks.iter().enumerate() {
                if distance2(own, theirs) < least {
                    least = self.least(i, other, j, least);
                }
            }
        }
        least
    }

    /// Returns the squared distance of a chunk of this ring and one of another, m²; `bound` if it is not
    /// below it.
    fn least(&self, own: usize, other: &Self, theirs: usize, bound: f64) -> f64 {
        let mut least = bound;
        for a in self.chunk(own) {
            let around = Bounds::of([a.0, a.1]);
            for b in other.chunk(theirs) {
                if distance2(&around, &Bounds::of([b.0, b.1])) < least {
                    least = least.min(segments(a, b));
                }
            }
        }
        least
    }

    fn chunk(&self, chunk: usize) -> impl Iterator<Item = (Vec2, Vec2)> + '_ {
        let first = chunk * CHUNK;
        let end = (first + CHUNK + 1).min(self.points.len());
        self.points[first..end].windows(2).map(|pair| (pair[0], pair[1]))
    }
}

/// Returns whether two segments have a common point. A distance would not do: that of a point of a segment
/// is 0 up to rounding only, and the sides of vehicles of equal width in a lane coincide.
fn meet((a, b): (Vec2, Vec2), (c, d): (Vec2, Vec2)) -> bool {
    if !Bounds::of([a, b]).intersects(&Bounds::of([c, d])) {
        return false;
    }
    let side = |from: Vec2, to: Vec2, p: Vec2| (to - from).perp(&(p - from));
    let is_beside = |from: Vec2, to: Vec2, p: Vec2, q: Vec2| {
        let (p, q) = (side(from, to, p), side(from, to, q));
        (p > 0.0 && q > 0.0) || (p < 0.0 && q < 0.0)
    };
    // Segments on one line whose bounds intersect overlap.
    !is_beside(a, b, c, d) && !is_beside(c, d, a, b)
}

/// Returns the squared distance of two bounds, m²; 0 if they intersect.
fn distance2(a: &Bounds, b: &Bounds) -> f64 {
    let apart = |a: [f64; 2], b: [f64; 2]| (a[0] - b[1]).max(b[0] - a[1]).max(0.0);
    let x = apart([a.min.x, a.max.x], [b.min.x, b.max.x]);
    let y = apart([a.min.y, a.max.y], [b.min.y, b.max.y]);
    x * x + y * y
}

/// The outline of the ground along a line, in the making.
#[derive(Debug)]
struct Outline {
    points: Vec<Vec2>,
    half_width: f64,
}

impl Outline {
    /// Adds the left side of a line after its begin, and the flat end.
    fn add_side(&mut self, points: &[Vec2]) {
        let sides: Vec<(Vec2, Vec2)> = points.windows(2).map(|pair| self.side(pair[0], pair[1])).collect();
        for (pair, corner) in sides.windows(2).zip(points.iter().skip(1)) {
            self.add_bend(*corner, pair[0], pair[1]);
        }
        if let (Some(side), Some(&end)) = (sides.last(), points.last()) {
            self.add(side.1);
            self.add(end * 2.0 - side.1);
        }
    }

    /// Returns the segment to the left of a segment.
    fn side(&self, a: Vec2, b: Vec2) -> (Vec2, Vec2) {
        let aside = left(b - a) * (self.half_width / (b - a).norm());
        (a + aside, b + aside)
    }

    /// Adds the part of a side at a point of the line, between the sides of the segments before and after it.
    fn add_bend(&mut self, corner: Vec2, before: (Vec2, Vec2), after: (Vec2, Vec2)) {
        let (ahead, next) = (before.1 - before.0, after.1 - after.0);
        let turn = ahead.perp(&next);
        let is_straight = turn == 0.0 && ahead.dot(&next) >= 0.0;
        let crossing = if turn > 0.0 { crossing(before, after) } else { None };
        if is_straight {
            return;
        }
        if let Some(crossing) = crossing {
            self.add(crossing);
        } else if (after.0 - before.1).norm() < SAME_END * self.half_width {
            self.add(before.1);
        } else if turn > 0.0 {
            let inwards = |end: Vec2| (end * INWARDS + corner) / (INWARDS + 1.0);
            for point in [before.1, inwards(before.1), inwards(after.0), after.0] {
                self.add(point);
            }
        } else {
            self.add_join(corner, before.1, after.0);
        }
    }

    /// Adds the round join at the outside of a bend, clockwise around `corner`.
    fn add_join(&mut self, corner: Vec2, from: Vec2, to: Vec2) {
        let start = heading_of(from - corner);
        let angle = (start - heading_of(to - corner)).rem_euclid(TAU);
        let count = (angle / JOIN_ANGLE).round().max(1.0);
        self.add(from);
        for i in 1..count as u32 {
            self.add(corner + direction(start - angle * f64::from(i) / count) * self.half_width);
        }
        self.add(to);
    }

    fn add(&mut self, point: Vec2) {
        let is_new = |last: &Vec2| (point - last).norm() >= SAME_POINT * self.half_width;
        if self.points.last().is_none_or(is_new) {
            self.points.push(point);
        }
    }
}

/// Returns the point in which two segments meet.
fn crossing((a, b): (Vec2, Vec2), (c, d): (Vec2, Vec2)) -> Option<Vec2> {
    let (own, other) = (b - a, d - c);
    let area = own.perp(&other);
    let along = (c - a).perp(&other) / area;
    let across = (c - a).perp(&own) / area;
    let is_within = |share: f64| (0.0..=1.0).contains(&share);
    (is_within(along) && is_within(across)).then(|| a + own * along)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    fn square(x: f64, y: f64, side: f64) -> Ground {
        Ground::of_box(&OrientedBox::new(v(x, y), 0.0, side, side))
    }

    #[test]
    fn strips_have_flat_ends_and_joins_of_chords() {
        let strip = Ground::along(&[v(0.0, 0.0), v(10.0, 0.0), v(10.0, 10.0)], 1.0);
        for (x, y, distance) in [(-3.0, 0.0, 2.5), (5.0, 4.0, 2.5), (10.0, 13.0, 2.5), (9.0, 13.0, 2.5)] {
            assert!((strip.distance(&square(x, y, 1.0)) - distance).abs() < 1e-12, "{x} {y}");
        }
        // The point of the join in the middle of its 16 segments is on the arc.
        let aside = v(10.0, 0.0) + v(1.0, -1.0) * 5.0;
        let middle = strip.distance(&Ground::inside(vec![aside, aside + v(1.0, -1.0)]));
        assert!((middle - (50.0_f64.sqrt() - 1.0)).abs() < 1e-12, "{middle}");
        assert!(strip.touches(&square(1.0, 0.5, 0.1)) && !strip.touches(&square(-0.2, 0.0, 0.1)));
    }

    #[test]
    fn grounds_of_equal_width_in_line_overlap() {
        for (heading, x) in [(0.0, 0.37), (0.0, 3.1), (0.7, 1.3), (-2.9, 7.77)] {
            let (ahead, at) = (direction(heading), |s: f64| v(11.3, -7.9) + direction(heading) * s);
            let strip = Ground::along(&(0..40).map(|i| at(0.9 * f64::from(i))).collect::<Vec<_>>(), 0.95);
            let vehicle = |s: f64| Ground::of_box(&OrientedBox::new(at(s), heading, 4.6, 1.9));
            assert!(strip.touches(&vehicle(x)) && strip.touches(&vehicle(10.0 + x)), "{ahead:?}");
            assert!(vehicle(x).touches(&vehicle(x + 1.0)) && vehicle(x).touches(&vehicle(x)));
            assert!(!strip.touches(&vehicle(-2.4)) && !strip.touches(&vehicle(0.9 * 39.0 + 2.4)));
        }
    }

    #[test]
    fn shallow_bends_have_one_chord() {
        // Turned by 5°: less than a segment and a half, so that the outside is one chord.
        let turned = 5.0_f64.to_radians();
        let strip = Ground::along(&[v(-9.0, 0.0), v(0.0, 0.0), direction(turned) * 9.0], 1.0);
        let outside = direction(0.5 * turned - FRAC_PI_2);
        let pole = Ground::inside(vec![outside * 3.0, outside * 4.0]);
        let expected = 3.0 - (0.5 * turned).cos();
        assert!((strip.distance(&pole) - expected).abs() < 1e-12);
    }

    #[test]
    fn unions_enclose_what_any_part_encloses() {
        let union = square(0.0, 0.0, 2.0).with(square(10.0, 0.0, 2.0));
        assert!(union.touches(&square(10.0, 0.0, 0.5)) && union.touches(&square(-1.5, 0.0, 1.0)));
        assert!(!union.touches(&square(5.0, 0.0, 2.0)));
        assert_eq!(union.distance(&square(6.0, 0.0, 2.0)), 2.0);
        assert_eq!(union.middle(), v(5.0, 0.0));
        assert!(square(0.0, 0.0, 30.0).touches(&union));
    }

    #[test]
    fn strips_that_begin_just_before_a_bend_cover_both_segments() {
        let points = [v(-1e-3, 0.0), v(0.0, 0.0), direction(0.09), direction(0.09) * 2.0];
        let strip = Ground::along(&points, 1.0);
        assert!(strip.touches(&square(0.5, 0.0, 0.01)) && strip.touches(&square(0.5, -0.9, 0.01)));
        assert!(strip.touches(&square(-0.05, 0.99, 0.01)) && !strip.touches(&square(-0.05, -0.5, 0.01)));
    }
}
