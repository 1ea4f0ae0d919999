//! Polylines with arc length.

use super::{Vec2, heading_of, left, point_segment};

/// A polyline of at least two distinct points, with the arc length at each point.
#[derive(Clone, Debug, PartialEq)]
pub struct Polyline {
    points: Vec<Vec2>,
    arc: Vec<f64>,
}

/// Squared ratio of the distance of a point to the least distance so far above which [`Polyline::project`]
/// skips segments: below it hardly any could be.
const FAR2: f64 = 9.0;

/// The reason why points do not form a polyline.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PolylineError {
    /// Fewer than two distinct points.
    #[error("a polyline needs at least two distinct points")]
    TooShort,
    /// A coordinate is NaN or infinite.
    #[error("point {0} of the polyline is not finite")]
    NotFinite(usize),
}

/// The point of a polyline nearest to a query point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Projection {
    /// Arc length of the nearest point, metres from the start.
    pub s: f64,
    /// Signed lateral offset of the query point, metres, left positive.
    pub offset: f64,
    /// Distance from the query point to the polyline, metres.
    pub distance: f64,
    /// Index of the segment that contains the nearest point (the first one on ties).
    pub segment: usize,
    /// Parameter along that segment, 0 to 1.
    pub t: f64,
}

impl Polyline {
    /// Creates a polyline; repeated points are dropped.
    ///
    /// # Errors
    /// [`PolylineError`] when a point is not finite or fewer than two distinct points remain.
    pub fn new(points: &[Vec2]) -> Result<Self, PolylineError> {
        if let Some(bad) = points.iter().position(|p| !(p.x.is_finite() && p.y.is_finite())) {
            return Err(PolylineError::NotFinite(bad));
        }
        let mut kept: Vec<Vec2> = Vec::with_capacity(points.len());
        let mut arc = Vec::with_capacity(points.len());
        for &p in points {
            match kept.last() {
                None => arc.push(0.0),
                Some(&last) => {
                    let step = (p - last).norm();
                    if step == 0.0 {
                        continue;
                    }
                    arc.push(arc[arc.len() - 1] + step);
                }
            }
            kept.push(p);
        }
        if kept.len() < 2 { Err(PolylineError::TooShort) } else { Ok(Self { points: kept, arc }) }
    }

    /// Returns the points, at least two.
    #[inline]
    pub fn points(&self) -> &[Vec2] {
        &self.points
    }

    /// Returns the arc length at each point, metres, starting at 0.
    #[inline]
    pub fn arc(&self) -> &[f64] {
        &self.arc
    }

    /// Returns the length, metres.
    #[inline]
    pub fn length(&self) -> f64 {
        self.arc[self.arc.len() - 1]
    }

    /// Returns the number of segments.
    #[inline]
    pub fn segments(&self) -> usize {
        self.points.len() - 1
    }

    /// Returns the end points of segment `i`.
    #[inline]
    pub fn segment(&self, i: usize) -> (Vec2, Vec2) {
        (self.points[i], self.points[i + 1])
    }

    /// Returns the heading of segment `i`, radians.
    #[inline]
    pub fn heading(&self, i: usize) -> f64 {
        heading_of(self.points[i + 1] - self.points[i])
    }

    /// Returns the segment that contains arc length `s` (clamped to the polyline).
    #[inline]
    pub fn segment_at(&self, s: f64) -> usize {
        self.arc.partition_point(|&a| a <= s).clamp(1, self.segments()) - 1
    }

    /// Returns the angle between the directions of two segments, radians, 0 to about 2, approximated by the
    /// chord of the unit circle.
    #[inline]
    pub fn turn_between(&self, i: usize, j: usize) -> f64 {
        let unit = |k: usize| {
            let (a, b) = self.segment(k);
            (b - a) / (self.arc[k + 1] - self.arc[k])
        };
        (unit(j) - unit(i)).norm()
    }

    /// Like [`Self::segment_at`], but searches from segment `near`: faster for an `s` close to it.
    #[inline]
    pub fn segment_from(&self, s: f64, near: usize) -> usize {
        let last = self.segments() - 1;
        let mut i = near.min(last);
        while i < last && self.arc[i + 1] <= s {
            i += 1;
        }
        while i > 0 && s < self.arc[i] {
            i -= 1;
        }
        i
    }

    /// Returns the point at arc length `s`, which is on segment `i` or beyond an end of the polyline.
    #[inline]
    pub fn on_segment(&self, s: f64, i: usize) -> Vec2 {
        let (a, b) = self.segment(i);
        a + (b - a) * ((s - self.arc[i]) / (self.arc[i + 1] - self.arc[i]))
    }

    /// Returns the point at arc length `s`; the end segments are extrapolated beyond the ends.
    #[inline]
    pub fn at(&self, s: f64) -> Vec2 {
        self.on_segment(s, self.segment_at(s))
    }

    /// Returns the heading of the segment at arc length `s`, radians.
    #[inline]
    pub fn heading_at(&self, s: f64) -> f64 {
        self.heading(self.segment_at(s))
    }

    /// Returns the line offset laterally by `offset` metres, left positive: each point moves along the normal
    /// of its segment.
    pub fn aside(&self, offset: f64) -> Self {
        let moved = self.points.iter().enumerate().map(|(i, &p)| {
            let (a, b) = self.segment(i.min(self.segments() - 1));
            let along = (b - a) / (b - a).norm();
            p + left(along) * offset
        });
        Self::new(&moved.collect::<Vec<_>>()).unwrap_or_else(|_| self.clone())
    }

    /// Projects `p` onto the nearest point over all segments.
    #[inline]
    pub fn project(&self, p: Vec2) -> Projection {
        self.project_between(p, 0, self.segments())
    }

    /// Projects `p` onto the nearest point over all segments; `None` if that is more than `distance` metres
    /// away.
    pub fn project_within(&self, p: Vec2, distance: f64) -> Option<Projection> {
        // The slack is larger than the error of the distances.
        let limit = distance * (1.0 + 1e-9) + 1e-9;
        let found = self.project_nearer(p, 0, self.segments(), limit * limit);
        (found.distance <= distance).then_some(found)
    }

    /// Projects `p` onto the nearest point over the segments `first..last` (clamped, at least one).
    pub fn project_between(&self, p: Vec2, first: usize, last: usize) -> Projection {
        let last = last.clamp(1, self.segments());
        self.project_nearer(p, first.min(last - 1), last, f64::INFINITY)
    }

    /// Projects `p` as [`Self::project_between`] does, faster for a point beside the first segments of a line
    /// that goes on ahead.
    pub fn project_ahead(&self, p: Vec2, first: usize, last: usize) -> Projection {
        let last = last.clamp(1, self.segments());
        let first = first.min(last - 1);
        let (mut best, mut segment, mut at) = (f64::INFINITY, first, 0.0);
        // The direction of the first segment in which the nearest point is, and the position along it of the
        // next point of the line.
        let mut ahead: Option<(Vec2, f64)> = None;
        // The slack is larger than the errors of the distances.
        let mut bound = f64::INFINITY;
        for i in first..last {
            let (a, b) = self.segment(i);
            if let Some((axis, from)) = &mut ahead {
                // No point of the segment is nearer than both of its ends along a direction.
                let to = axis.dot(&(b - p));
                let nearest = from.min(to);
                *from = to;
                if nearest > bound {
                    continue;
                }
            }
            let (d2, t) = point_segment(p, a, b);
            if d2 < best {
                (best, segment, at) = (d2, i, t);
                bound = best.sqrt() * (1.0 + 1e-9) + 1e-9;
            }
            if ahead.is_none() && t < 1.0 {
                let axis = (b - a) / (self.arc[i + 1] - self.arc[i]);
                ahead = Some((axis, axis.dot(&(b - p))));
            }
        }
        self.projection(p, segment, at, best)
    }

    /// Projects `p` onto the nearest point over the segments `first..last` whose squared distance is less
    /// than `limit2`, m²; without such a point, the result has that distance.
    #[inline]
    fn project_nearer(&self, p: Vec2, first: usize, last: usize, limit2: f64) -> Projection {
        let (mut best, mut segment, mut at) = (limit2, first, 0.0);
        let mut i = first;
        while i < last {
            // Along the line the distance shrinks at most by the arc length: segments that end within the
            // difference to the best one are farther away.
            let here2 = (self.points[i] - p).norm_squared();
            if here2 > FAR2 * best {
                let within = self.arc[i] + (here2.sqrt() - best.sqrt()) * (1.0 - 1e-9) - 1e-9;
                let from = i;
                while i < last && self.arc[i + 1] < within {
                    i += 1;
                }
                if i > from {
                    continue;
                }
            }
            let (d2, t) = point_segment(p, self.points[i], self.points[i + 1]);
            if d2 < best {
                (best, segment, at) = (d2, i, t);
            }
            i += 1;
        }
        self.projection(p, segment, at, best)
    }

    /// Returns the projection of `p` onto the point at parameter `at` of a segment, whose squared distance is
    /// `distance2`.
    #[inline]
    fn projection(&self, p: Vec2, segment: usize, at: f64, distance2: f64) -> Projection {
        let (a, b) = self.segment(segment);
        let ab = b - a;
        let side = ab.perp(&(p - a));
        let distance = distance2.sqrt();
        Projection {
            s: self.arc[segment] + at * (self.arc[segment + 1] - self.arc[segment]),
            offset: if side >= 0.0 { distance } else { -distance },
            distance,
            segment,
            t: at,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn a_projection_is_the_nearest_of_all_segments(
            steps in prop::collection::vec((-4.0..6.0_f64, -4.0..4.0_f64), 1..60),
            (x, y) in (-30.0..90.0_f64, -40.0..40.0_f64),
            (first, count) in (0..50_usize, 1..60_usize),
        ) {
            let mut points = vec![Vec2::zeros()];
            // Whole metres, so that there are ties.
            points.extend(steps.iter().scan(Vec2::zeros(), |at, (dx, dy)| {
                *at += Vec2::new(dx.round(), dy.round());
                Some(*at)
            }));
            let Ok(line) = Polyline::new(&points) else { return Ok(()) };
            let p = Vec2::new(x.round(), y.round());
            let last = (first + count).clamp(1, line.segments());
            let d2 = |i: usize| point_segment(p, line.points[i], line.points[i + 1]).0;
            let all = first.min(last - 1)..last;
            let nearest = all.fold((f64::INFINITY, 0), |a, i| if d2(i) < a.0 { (d2(i), i) } else { a });
            let found = line.project_between(p, first, first + count);
            prop_assert_eq!((found.distance, found.segment), (nearest.0.sqrt(), nearest.1));
            prop_assert_eq!(line.project_ahead(p, first, first + count), found);
            let whole = line.project(p);
            for distance in [0.0, 1.0, 5.0, whole.distance] {
                let wanted = (whole.distance <= distance).then_some(whole);
                prop_assert_eq!(line.project_within(p, distance), wanted);
            }
        }
    }

    #[test]
    fn projects_with_sign_and_arc_length() {
        let line =
            Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(10.0, 10.0)]).unwrap();
        let left = line.project(Vec2::new(4.0, 1.5));
        assert_eq!((left.s, left.offset, left.segment), (4.0, 1.5, 0));
        let right = line.project(Vec2::new(12.0, 5.0));
        assert_eq!((right.s, right.offset, right.segment), (15.0, -2.0, 1));
        assert_eq!(line.at(-1.0), Vec2::new(-1.0, 0.0));
        assert_eq!(line.at(21.0), Vec2::new(10.0, 11.0));
    }

    #[test]
    fn refuses_invalid_points() {
        assert_eq!(Polyline::new(&[Vec2::zeros(), Vec2::zeros()]), Err(PolylineError::TooShort));
        assert_eq!(
            Polyline::new(&[Vec2::zeros(), Vec2::new(f64::NAN, 0.0)]),
            Err(PolylineError::NotFinite(1))
        );
    }
}
