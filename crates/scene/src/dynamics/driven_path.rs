//! Drivable paths: chains of short arcs of bounded, slowly changing curvature.

use reactsim_geometry::{Bounds, Polyline, Vec2, direction, math, wrap};

use super::Pose;

/// A path of arcs of equal length. Between two points the curvature is that of the first.
#[derive(Clone, Debug)]
pub struct DrivenPath {
    points: Vec<PathPoint>,
    bounds: Vec<Bounds>,
    /// Sum of the absolute turns before each point, radians.
    turns: Vec<f64>,
}

/// A point of a [`DrivenPath`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathPoint {
    /// Position and heading.
    pub pose: Pose,
    /// Unit vector along the heading.
    pub axis: Vec2,
    /// Curvature of the arc that begins here, 1/m.
    pub curvature: f64,
}

impl PathPoint {
    fn new(pose: Pose, curvature: f64) -> Self {
        Self { pose, axis: direction(pose.heading), curvature }
    }

    /// Returns the point `distance` metres along the arc that begins here, with the same curvature:
    /// [`Pose::advance`], but rotates the axis instead of recomputing it.
    fn next(&self, distance: f64) -> Self {
        let half = 0.5 * self.curvature * distance;
        // For the small turns of one step these series are exact to the last digit.
        let h2 = half * half;
        let (sin, cos) = if half.abs() < 0.15 {
            let sinc = 1.0 - h2 / 6.0 * (1.0 - h2 / 20.0 * (1.0 - h2 / 42.0 * (1.0 - h2 / 72.0)));
            let cos = 1.0
                - h2 / 2.0 * (1.0 - h2 / 12.0 * (1.0 - h2 / 30.0 * (1.0 - h2 / 56.0 * (1.0 - h2 / 90.0))));
            (half * sinc, cos)
        } else {
            math::sin_cos(half)
        };
        let turn = |v: Vec2| Vec2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos);
        let middle = turn(self.axis);
        let chord = if half.abs() < 1e-9 { distance } else { distance * sin / half };
        Self {
            pose: Pose {
                position: self.pose.position + middle * chord,
                heading: wrap(self.pose.heading + 2.0 * half),
            },
            axis: turn(middle),
            curvature: self.curvature,
        }
    }
}

/// Projection of a position onto a path.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathProjection {
    /// Arc length, metres; negative before the start, greater than the length beyond the end.
    pub s: f64,
    /// Lateral offset, metres, left positive.
    pub offset: f64,
    /// Index of the nearest point.
    pub index: usize,
}

/// Parameters of pure pursuit along a reference line.
#[derive(Clone, Copy, Debug)]
pub struct Pursuit {
    /// Distance along the reference line to the target point, metres.
    pub look_ahead: f64,
    /// Largest curvature, 1/m.
    pub max_curvature: f64,
    /// Largest change of curvature along the path, 1/m².
    pub max_curvature_rate: f64,
}

impl Pursuit {
    /// Returns the look-ahead distance in a bend of `turn` radians, shorter in sharp bends: pure
    /// pursuit cuts a bend by about an eighth of the product of look-ahead and turn.
    fn look_ahead_in_bend(&self, turn: f64) -> f64 {
        let cut = self.look_ahead * turn / 8.0;
        if cut <= Self::MAX_CORNER_CUT {
            return self.look_ahead;
        }
        (self.look_ahead * (Self::MAX_CORNER_CUT / cut).sqrt()).max(Self::MIN_LOOK_AHEAD.min(self.look_ahead))
    }

    /// Largest distance by which a bend may be cut, metres.
    const MAX_CORNER_CUT: f64 = 0.4;
    /// Smallest look-ahead distance, metres: below it pure pursuit oscillates about the line.
    const MIN_LOOK_AHEAD: f64 = 3.5;
}

impl DrivenPath {
    /// Length of every arc, metres.
    pub const STEP: f64 = 1.0;
    /// Number of arcs per bounding box.
    const BLOCK: usize = 8;

    /// Steers from `start` (with curvature `curvature`, 1/m) onto `reference` by pure pursuit, for
    /// `length` metres. Beyond its end the reference is extended straight. Curvature and its rate
    /// of change stay within the limits of `pursuit`.
    ///
    /// Source: Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm
    /// (CMU-RI-TR-92-01).
    pub fn pursue(start: Pose, curvature: f64, reference: &Polyline, length: f64, pursuit: &Pursuit) -> Self {
        let count = (length / Self::STEP).ceil().max(1.0) as usize + 1;
        let limit = pursuit.max_curvature;
        let change = pursuit.max_curvature_rate * Self::STEP;
        let mut points = Vec::with_capacity(count);
        let mut here = PathPoint::new(start, curvature.clamp(-limit, limit));
        let mut segment = reference.project(here.pose.position).segment;
        let mut aim = segment;
        for _ in 0..count {
            let near = reference.project_ahead(here.pose.position, segment, segment + 12);
            segment = near.segment;
            // Beyond its end the reference is extended straight.
            let beyond = if near.segment + 1 == reference.segments() && near.t >= 1.0 {
                let (a, b) = reference.segment(near.segment);
                (here.pose.position - b).dot(&(b - a)) / (b - a).norm()
            } else {
                0.0
            };
            let from = near.s + beyond;
            aim = reference.segment_from(from + pursuit.look_ahead, aim);
            let look_ahead = pursuit.look_ahead_in_bend(reference.turn_between(segment, aim));
            let goal_s = from + look_ahead;
            if look_ahead < pursuit.look_ahead {
                aim = reference.segment_from(goal_s, aim);
            }
            let goal = reference.on_segment(goal_s, aim) - here.pose.position;
            let distance = goal.norm();
            let desired = if here.axis.dot(&goal) < 0.0 {
                // A goal behind the vehicle needs the tightest turn towards it.
                limit.copysign(here.axis.perp(&goal))
            } else {
                (2.0 * here.axis.perp(&goal) / (distance * distance.max(1.0)).max(1e-9)).clamp(-limit, limit)
            };
            here.curvature += (desired - here.curvature).clamp(-change, change);
            points.push(here);
            here = here.next(Self::STEP);
        }
        Self::of(points)
    }

    /// Builds a path of `length` metres whose curvature decays from `curvature` with the length
    /// scale `fade` (metres).
    pub fn fade(start: Pose, curvature: f64, fade: f64, length: f64) -> Self {
        let count = (length / Self::STEP).ceil().max(1.0) as usize + 1;
        let mut points = Vec::with_capacity(count);
        let mut here = PathPoint::new(start, curvature);
        for k in 0..count {
            here.curvature = curvature * math::exp(-(k as f64) * Self::STEP / fade);
            points.push(here);
            here = here.next(Self::STEP);
        }
        Self::of(points)
    }

    fn of(points: Vec<PathPoint>) -> Self {
        let block = |first: usize| {
            let last = (first + Self::BLOCK).min(points.len() - 1);
            Bounds::of(points[first..=last].iter().map(|p| p.pose.position))
        };
        let bounds = (0..points.len()).step_by(Self::BLOCK).map(block).collect();
        let before = |sum: &mut f64, point: &PathPoint| {
            let before = *sum;
            *sum += point.curvature.abs() * Self::STEP;
            Some(before)
        };
        let turns = points.iter().scan(0.0, before).collect();
        Self { points, bounds, turns }
    }

    /// Returns the points, one per metre.
    #[inline]
    pub fn points(&self) -> &[PathPoint] {
        &self.points
    }

    /// Returns the sum of the absolute turns between two points, by index, radians.
    #[inline]
    pub fn turn_between(&self, from: usize, to: usize) -> f64 {
        self.turns[to] - self.turns[from]
    }

    /// Returns the length, metres.
    #[inline]
    pub fn length(&self) -> f64 {
        (self.points.len() - 1) as f64 * Self::STEP
    }

    /// Returns the index of the arc that contains arc length `s`.
    #[inline]
    pub fn index(&self, s: f64) -> usize {
        ((s / Self::STEP).max(0.0) as usize).min(self.points.len() - 1)
    }

    /// Returns the pose at arc length `s`; before the start and beyond the end the path is
    /// straight.
    #[inline]
    pub fn at(&self, s: f64) -> Pose {
        self.point_at(s).pose
    }

    /// Like [`Self::at`], but with curvature and the unit vector along the heading.
    #[inline]
    pub fn point_at(&self, s: f64) -> PathPoint {
        let i = self.index(s);
        let along = s - i as f64 * Self::STEP;
        let straight = along < 0.0 || i + 1 == self.points.len();
        let point = self.points[i];
        PathPoint { curvature: if straight { 0.0 } else { point.curvature }, ..point }.next(along)
    }

    /// Returns bounds of the centre line between two arc lengths. They are slightly too large,
    /// because they are made of blocks of several metres.
    pub fn bounds(&self, from: f64, to: f64) -> Bounds {
        let (first, last) = (self.index(from) / Self::BLOCK, self.index(to) / Self::BLOCK);
        self.bounds[first..=last].iter().fold(Bounds::EMPTY, |a, b| a.union(b))
    }

    /// Projects `p` onto the section between the point indices `first` and `last`, starting the
    /// search at `near` if given.
    ///
    /// With `near` the search only descends from there, which suffices for a point that moves step
    /// by step.
    pub fn project(&self, p: Vec2, first: usize, last: usize, near: Option<usize>) -> PathProjection {
        let last = last.min(self.points.len() - 1);
        let first = first.min(last);
        let d2 = |i: usize| (self.points[i].pose.position - p).norm_squared();
        let start = near.map_or_else(
            || {
                let coarse = (first..=last).step_by(4).chain([last]);
                let nearest = |a: (usize, f64), b: (usize, f64)| if b.1 < a.1 { b } else { a };
                coarse.map(|i| (i, d2(i))).fold((first, f64::INFINITY), nearest).0
            },
            |i| i.clamp(first, last),
        );
        let here = d2(start);
        let lower = if start > first { d2(start - 1) } else { f64::INFINITY };
        let upper = if start < last { d2(start + 1) } else { f64::INFINITY };
        let index = if lower < here && lower <= upper {
            self.descend(p, start, first, |i| i - 1)
        } else if upper < here {
            self.descend(p, start, last, |i| i + 1)
        } else {
            start
        };
        let point = &self.points[index];
        let d = p - point.pose.position;
        PathProjection {
            s: index as f64 * Self::STEP + d.dot(&point.axis),
            offset: point.axis.perp(&d),
            index,
        }
    }

    /// Returns the first point from `start` towards `end` whose successor in that direction is no nearer to
    /// `p`.
    fn descend(&self, p: Vec2, start: usize, end: usize, next: impl Fn(usize) -> usize) -> usize {
        let d2 = |i: usize| (self.points[i].pose.position - p).norm_squared();
        let mut index = self.skip_towards(p, start, end);
        let mut best = d2(index);
        while index != end {
            let following = d2(next(index));
            if following >= best {
                break;
            }
            (index, best) = (next(index), following);
        }
        index
    }

    /// Returns a point between `start` and `end` up to which every point is nearer to `p` than the one
    /// before.
    fn skip_towards(&self, p: Vec2, start: usize, end: usize) -> usize {
        /// Largest turn of the points that are skipped, radians.
        const MAX_TURN: f64 = 0.2;
        /// Largest number of points that are skipped.
        const MAX_POINTS: f64 = 16.0;
        // The chord of each skipped arc deviates by at most 0.2 from the axis here, and the path by at most
        // 16 sin(0.2) = 3.2 m to the side. With more than 1 m + lateral / 2 left along the axis, the way to
        // `p` has a component along the chord of at least (1 + lateral / 2) cos(0.2) - (lateral + 3.2)
        // sin(0.2) > 0.3 m: each step along a chord brings `p` nearer, whatever the rounding.
        let point = &self.points[start];
        let d = p - point.pose.position;
        let (along, lateral) = (d.dot(&point.axis), point.axis.perp(&d).abs());
        let along = if end < start { -along } else { along };
        let count = (along / Self::STEP - 0.5 * lateral - 0.5).clamp(0.0, MAX_POINTS) as usize;
        let there = if end < start { start - count.min(start - end) } else { start + count.min(end - start) };
        if (self.turns[there] - self.turns[start]).abs() <= MAX_TURN { there } else { start }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn straight() -> Polyline {
        Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(200.0, 0.0)]).unwrap()
    }

    const PURSUIT: Pursuit = Pursuit { look_ahead: 10.0, max_curvature: 0.19, max_curvature_rate: 0.05 };

    #[test]
    fn steers_onto_the_line_within_its_limits() {
        let start = Pose { position: Vec2::new(0.0, 2.0), heading: 0.3 };
        let path = DrivenPath::pursue(start, 0.0, &straight(), 80.0, &PURSUIT);
        let end = path.at(80.0);
        assert!(end.position.y.abs() < 0.02 && end.heading.abs() < 0.01, "{end:?}");
        for w in path.points().windows(2) {
            assert!(w[1].curvature.abs() <= 0.19);
            assert!((w[1].curvature - w[0].curvature).abs() <= 0.05 + 1e-12);
        }
    }

    #[test]
    fn goes_on_straight_beyond_the_end_of_the_line() {
        let short = Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0)]).unwrap();
        let start = Pose { position: Vec2::new(0.0, 0.5), heading: 0.0 };
        let path = DrivenPath::pursue(start, 0.0, &short, 80.0, &PURSUIT);
        let end = path.at(80.0);
        assert!(end.position.x > 79.0 && end.position.y.abs() < 0.1 && end.heading.abs() < 0.01, "{end:?}");
    }

    /// Returns the nearest point by descending step by step from the nearest of every fourth point.
    fn nearest_step_by_step(
        path: &DrivenPath,
        p: Vec2,
        first: usize,
        last: usize,
        near: Option<usize>,
    ) -> usize {
        let d2 = |i: usize| (path.points[i].pose.position - p).norm_squared();
        let coarse = (first..=last).step_by(4).chain([last]);
        let mut at = near.map_or_else(
            || coarse.fold((first, f64::INFINITY), |a, i| if d2(i) < a.1 { (i, d2(i)) } else { a }).0,
            |i| i.clamp(first, last),
        );
        loop {
            let lower = if at > first { d2(at - 1) } else { f64::INFINITY };
            let upper = if at < last { d2(at + 1) } else { f64::INFINITY };
            if lower < d2(at) && lower <= upper {
                at -= 1;
            } else if upper < d2(at) {
                at += 1;
            } else {
                return at;
            }
        }
    }

    proptest! {
        #[test]
        fn skipping_points_changes_no_projection(
            heading in -1.0..1.0_f64,
            curvature in -0.2..0.2_f64,
            fade in 2.0..300.0_f64,
            (x, y) in (-120.0..240.0_f64, -40.0..40.0_f64),
            near in prop::option::of(0..200_usize),
            (first, count) in (0..60_usize, 0..140_usize),
        ) {
            let start = Pose { position: Vec2::new(0.0, 0.0), heading };
            let path = DrivenPath::fade(start, curvature, fade, 180.0);
            let last = (first + count).min(path.points.len() - 1);
            let first = first.min(last);
            // Beside a point of the path and anywhere.
            let beside = path.point_at(x.abs().floor()).pose.position + Vec2::new(0.0, (y / 10.0).round() / 2.0);
            for p in [beside, Vec2::new(x, y)] {
                let found = path.project(p, first, last, near).index;
                prop_assert_eq!(found, nearest_step_by_step(&path, p, first, last, near));
            }
        }
    }

    #[test]
    fn projection_inverts_the_path() {
        let start = Pose { position: Vec2::new(0.0, -3.0), heading: -0.2 };
        let path = DrivenPath::pursue(start, 0.1, &straight(), 60.0, &PURSUIT);
        for s in [0.0, 3.3, 17.9, 59.0] {
            let pose = path.at(s);
            let left = Vec2::new(-pose.heading.sin(), pose.heading.cos());
            let found = path.project(pose.position + left * 1.5, 0, usize::MAX, None);
            assert!((found.s - s).abs() < 0.1 && (found.offset - 1.5).abs() < 0.05, "{s}: {found:?}");
        }
    }
}
