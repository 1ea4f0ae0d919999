//! Paths along the lanes of the route, and the corridors that ego covers on them.

use std::f64::consts::{FRAC_PI_2, TAU};

use reactsim_geometry::{
    Bounds, OrientedBox, Polyline, Projection, Vec2, direction, heading_of, point_segment, wrap,
};

use crate::shapes::{
    CHUNK, Shape, box_touches_ring, chunk_bounds, edges, is_segment_near_box, ring_covers, segments,
};
use crate::trajectory::Pose;

/// Largest distance between states of a baseline, metres: longer segments are divided. The states of
/// nuPlan's baselines are closer.
const STATE_SPACING: f64 = 1.0;
/// Distance in metres up to which two states are at the same place (NumPy 1.23, `isclose`).
const SAME_STATE: f64 = 1e-8;
/// Least arc length, metres, at which a path has a pose (tuplan_garage b51d5d0, `PDMPath.interpolate`).
const FIRST_PROGRESS: f64 = 1e-5;

/// Returns the states of a baseline: its points and, on longer segments, a point every metre. The heading
/// of a state is that of the segment after it; the last state has the heading of the last segment.
pub(crate) fn baseline_states(baseline: &Polyline) -> Vec<Pose> {
    let mut states = Vec::new();
    for segment in 0..baseline.segments() {
        let (a, b) = baseline.segment(segment);
        let heading = heading_of(b - a);
        let length = (b - a).norm();
        let pieces = (length / STATE_SPACING - 1e-6).ceil().max(1.0) as usize;
        let along = (b - a) * (STATE_SPACING / length);
        states.extend((0..pieces).map(|piece| Pose { position: a + along * piece as f64, heading }));
    }
    let last = baseline.segments() - 1;
    states.push(Pose { position: baseline.segment(last).1, heading: baseline.heading(last) });
    states
}

/// Returns the state of a baseline that is nearest to `p`, with its distance in metres.
pub(crate) fn nearest_state(baseline: &Polyline, p: Vec2) -> (f64, Pose) {
    let states = baseline_states(baseline);
    let mut nearest = (f64::INFINITY, states[0]);
    for state in states {
        let distance = (state.position - p).norm();
        if distance < nearest.0 {
            nearest = (distance, state);
        }
    }
    nearest
}

/// Returns the states that the paths of nuPlan keep: those that are not at the same place as the next one,
/// and never the last one, so that a path ends a state before its last lane (devkit 1.2.2,
/// `create_path_from_se2`).
pub(crate) fn kept_states(states: &[Pose]) -> Vec<Pose> {
    let is_kept = |pair: &&[Pose]| (pair[1].position - pair[0].position).norm() > SAME_STATE;
    states.windows(2).filter(is_kept).map(|pair| pair[0]).collect()
}

/// A path with poses by arc length.
#[derive(Clone, Debug)]
pub struct Path {
    /// States, headings unwrapped.
    states: Vec<Pose>,
    /// Arc length at each state, metres.
    arc: Vec<f64>,
    line: Polyline,
    /// Bounds of each [`CHUNK`] segments of the line.
    chunks: Vec<Bounds>,
}

impl Path {
    /// Creates a path through states; `None` if they have no length or are not finite.
    pub(crate) fn new(mut states: Vec<Pose>) -> Option<Self> {
        let positions: Vec<Vec2> = states.iter().map(|state| state.position).collect();
        let line = Polyline::new(&positions).ok()?;
        unwrap_headings(&mut states);
        let mut arc = vec![0.0; states.len()];
        for i in 1..states.len() {
            arc[i] = arc[i - 1] + (positions[i] - positions[i - 1]).norm();
        }
        let chunks = chunk_bounds(line.points(), 0.0);
        Some(Self { states, arc, line, chunks })
    }

    /// Returns the path through all states moved by `offset` metres along their headings turned left by
    /// 90°.
    pub(crate) fn aside(&self, offset: f64) -> Option<Self> {
        let moved = |state: &Pose| Pose {
            position: state.position + direction(state.heading + FRAC_PI_2) * offset,
            ..*state
        };
        Self::new(self.states.iter().map(moved).collect())
    }

    /// Returns the states.
    pub fn states(&self) -> &[Pose] {
        &self.states
    }

    /// Returns the length, metres.
    pub fn length(&self) -> f64 {
        self.arc[self.arc.len() - 1]
    }

    /// Returns the arc length of the point nearest to `p`, metres; the first one on ties.
    pub fn project(&self, p: Vec2) -> f64 {
        let within = |chunk: usize| self.line.project_between(p, chunk * CHUNK, (chunk + 1) * CHUNK);
        let mut closest = (f64::INFINITY, 0);
        for (i, chunk) in self.chunks.iter().enumerate() {
            let distance2 = chunk.distance2(p);
            if distance2 < closest.0 {
                closest = (distance2, i);
            }
        }
        // Chunks beyond the distance to the closest one need no search.
        let bound = within(closest.1).distance * (1.0 + 1e-12);
        let mut nearest: Option<Projection> = None;
        for (i, chunk) in self.chunks.iter().enumerate() {
            if chunk.distance2(p) > bound * bound {
                continue;
            }
            let found = within(i);
            if nearest.is_none_or(|nearest| found.distance < nearest.distance) {
                nearest = Some(found);
            }
        }
        nearest.map_or(0.0, |nearest| nearest.s)
    }

    /// Returns the pose at an arc length in metres, which is clamped to the path.
    pub fn at(&self, progress: f64) -> Pose {
        self.between_states(progress.clamp(FIRST_PROGRESS, self.length().max(FIRST_PROGRESS)))
    }

    /// Returns the pose at an arc length in metres, which is clamped to the path, its very start included, as
    /// nuPlan does (devkit 1.2.2, `InterpolatedPath`).
    pub(crate) fn interpolated(&self, progress: f64) -> Pose {
        self.between_states(progress.clamp(0.0, self.length()))
    }

    /// Returns the pose at an arc length in metres on the path.
    fn between_states(&self, progress: f64) -> Pose {
        let after = self.arc.partition_point(|&arc| arc < progress).clamp(1, self.arc.len() - 1);
        let (a, b) = (&self.states[after - 1], &self.states[after]);
        let length = self.arc[after] - self.arc[after - 1];
        let share = if length > 0.0 { (progress - self.arc[after - 1]) / length } else { 0.0 };
        Pose {
            position: a.position + (b.position - a.position) * share,
            heading: wrap(a.heading + (b.heading - a.heading) * share),
        }
    }

    /// Returns the corridor within `half_width` metres of the states between two arc lengths. Where there
    /// are fewer than two states, the arc lengths themselves are its ends.
    pub(crate) fn corridor(&self, from: f64, to: f64, half_width: f64) -> Corridor {
        let within = |&(_, arc): &(&Pose, &f64)| from <= *arc && *arc <= to;
        let mut points: Vec<Vec2> =
            self.states.iter().zip(&self.arc).filter(within).map(|(state, _)| state.position).collect();
        if points.len() < 2 {
            points = self.exact_part(from, to);
        }
        Corridor::new(points, half_width)
    }

    /// Returns the corridor within `half_width` metres of the path between two arc lengths, which are
    /// clamped to the path.
    pub(crate) fn exact_corridor(&self, from: f64, to: f64, half_width: f64) -> Corridor {
        let part = self.trimmed(from, to);
        Corridor::new(part.into_iter().map(|state| state.position).collect(), half_width)
    }

    /// Returns the part of the path between two arc lengths in metres, which are clamped to the path: the
    /// poses at them and the states between. At the very end of the path the part is its last two states, at
    /// the very start its first two (nuPlan devkit 1.2.2, `trim_path`).
    pub(crate) fn trimmed(&self, from: f64, to: f64) -> Vec<Pose> {
        let [from, to] = [from, to].map(|end| end.clamp(0.0, self.length()));
        let (first, count) = (self.arc.partition_point(|&arc| arc <= from), self.states.len());
        if first == count {
            return self.states[count - 2..].to_vec();
        }
        let end = self.arc.partition_point(|&arc| arc < to);
        if end == 0 {
            return self.states[..2].to_vec();
        }
        let inner = self.states[first..end.max(first)].iter().copied();
        [self.between_states(from)].into_iter().chain(inner).chain([self.between_states(to)]).collect()
    }

    /// Returns the rest of the path from an arc length in metres on, which is clamped to the path: the pose
    /// at it and the states after it; at the very end of the path its last two states (nuPlan devkit 1.2.2,
    /// `trim_path_up_to_progress`).
    pub(crate) fn from(&self, progress: f64) -> Vec<Pose> {
        let progress = progress.clamp(0.0, self.length());
        let (first, count) = (self.arc.partition_point(|&arc| arc <= progress), self.states.len());
        if first == count {
            return self.states[count - 2..].to_vec();
        }
        let rest = self.states[first..].iter().copied();
        [self.between_states(progress)].into_iter().chain(rest).collect()
    }

    /// Returns the points of the path between two arc lengths, and its points at them.
    fn exact_part(&self, from: f64, to: f64) -> Vec<Vec2> {
        let ends = [from, to].map(|end| self.line.at(end.clamp(0.0, self.length())));
        let between = self.line.points().iter().zip(self.line.arc());
        let inner = between.filter(|&(_, &arc)| from < arc && arc < to).map(|(&point, _)| point);
        [ends[0]].into_iter().chain(inner).chain([ends[1]]).collect()
    }
}

/// Adds multiples of a turn so that successive headings differ by at most half a turn.
fn unwrap_headings(states: &mut [Pose]) {
    for i in 1..states.len() {
        let turns = ((states[i].heading - states[i - 1].heading) / TAU).round();
        states[i].heading -= turns * TAU;
    }
}

/// The ground within a distance of a line, with square ends.
#[derive(Clone, Debug)]
pub(crate) struct Corridor {
    points: Vec<Vec2>,
    half_width: f64,
    /// Bounds of the ground around each [`CHUNK`] segments.
    chunks: Vec<Bounds>,
    /// The square ends: boxes around the end points.
    ends: [OrientedBox; 2],
    bounds: Bounds,
}

impl Corridor {
    /// Creates the corridor around at least one point.
    fn new(points: Vec<Vec2>, half_width: f64) -> Self {
        // The diagonal of the square ends.
        let margin = half_width * std::f64::consts::SQRT_2;
        let chunks = chunk_bounds(&points, margin);
        let bounds = Bounds::of(points.iter().copied()).inflated(margin);
        let (first, last) = (points[0], points[points.len() - 1]);
        let heading = |from: usize, to: usize| match (points.get(from), points.get(to)) {
            (Some(a), Some(b)) => heading_of(b - a),
            _ => 0.0,
        };
        let ends = [
            OrientedBox::new(first, heading(0, 1), 2.0 * half_width, 2.0 * half_width),
            OrientedBox::new(
                last,
                heading(points.len().saturating_sub(2), points.len() - 1),
                2.0 * half_width,
                2.0 * half_width,
            ),
        ];
        Self { points, half_width, chunks, ends, bounds }
    }

    /// Returns whether the corridor touches or overlaps a shape.
    pub(crate) fn touches(&self, shape: &Shape) -> bool {
        match shape {
            Shape::Box(other) => self.touches_box(other, other.radius()),
            Shape::Outline(ring) => self.touches_ring(ring),
        }
    }

    /// Returns whether the corridor touches or overlaps a box with this radius (m) of its circumscribed
    /// circle.
    pub(crate) fn touches_box(&self, other: &OrientedBox, radius: f64) -> bool {
        if !self.bounds.inflated(radius).contains(other.center) {
            return false;
        }
        let reach = self.half_width;
        // Most segments are decided by their distance from the centre of the box.
        let (near, far) = (reach + other.half_length.min(other.half_width), reach + radius);
        let touches = |a: Vec2, b: Vec2| {
            let distance2 = point_segment(other.center, a, b).0;
            distance2 <= near * near || (distance2 <= far * far && is_segment_near_box(a, b, other, reach))
        };
        self.any_segment_near(&Bounds::around(other.center, radius), touches)
            || self.ends.iter().any(|end| end.separation(other) <= 0.0)
    }

    fn touches_ring(&self, ring: &[Vec2]) -> bool {
        let reach2 = self.half_width * self.half_width;
        ring_covers(ring, self.points[0])
            || self.any_segment_near(&Bounds::of(ring.iter().copied()), |a, b| {
                edges(ring).any(|edge| segments((a, b), edge) <= reach2)
            })
            || self.ends.iter().any(|end| box_touches_ring(end, ring))
    }

    /// Returns whether `test` holds for a segment of a chunk that `bounds` intersect.
    fn any_segment_near(&self, bounds: &Bounds, test: impl Fn(Vec2, Vec2) -> bool) -> bool {
        self.chunks.iter().enumerate().filter(|(_, chunk)| chunk.intersects(bounds)).any(|(i, _)| {
            let first = i * CHUNK;
            let last = (first + CHUNK + 1).min(self.points.len());
            self.points[first..last].windows(2).any(|pair| test(pair[0], pair[1]))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn v(x: f64, y: f64) -> Vec2 {
        Vec2::new(x, y)
    }

    fn straight() -> Path {
        Path::new(baseline_states(&Polyline::new(&[v(0.0, 0.0), v(20.5, 0.0)]).unwrap())).unwrap()
    }

    #[test]
    fn long_segments_have_a_state_every_metre() {
        let path = straight();
        assert_eq!(path.states().len(), 22);
        assert_eq!(path.states()[20].position, v(20.0, 0.0));
        assert_eq!(path.length(), 20.5);
        let dense = Polyline::new(&[v(0.0, 0.0), v(0.6, 0.0), v(1.6, 0.0)]).unwrap();
        assert_eq!(baseline_states(&dense).len(), 3);
    }

    #[test]
    fn poses_are_linear_between_states_and_clamped() {
        let states = vec![
            Pose { position: v(0.0, 0.0), heading: 3.0 },
            Pose { position: v(1.0, 0.0), heading: -3.0 },
            Pose { position: v(1.0, 0.0), heading: -3.0 },
            Pose { position: v(3.0, 0.0), heading: -2.5 },
        ];
        let path = Path::new(states).unwrap();
        assert!((path.at(0.5).heading.abs() - std::f64::consts::PI).abs() < 1e-12);
        assert_eq!(path.at(2.0).position, v(2.0, 0.0));
        assert_eq!(path.at(9.0).position, v(3.0, 0.0));
        assert_eq!(path.at(-1.0).position, v(FIRST_PROGRESS, 0.0));
    }

    #[test]
    fn corridors_have_square_ends() {
        let corridor = straight().corridor(4.5, 10.2, 1.0);
        let at = |x: f64, y: f64| Shape::Box(OrientedBox::new(v(x, y), 0.0, 0.2, 0.2));
        // From the state at 5 m to that at 10 m, and 1 m beyond both.
        for (x, y, inside) in [
            (3.95, 0.95, true),
            (3.85, 0.0, false),
            (11.05, -0.95, true),
            (11.15, 0.0, false),
            (7.0, 1.05, true),
            (7.0, 1.15, false),
        ] {
            assert_eq!(corridor.touches(&at(x, y)), inside, "{x} {y}");
        }
        let far = Shape::Outline(vec![v(7.0, 1.2), v(9.0, 1.2), v(9.0, 2.0)]);
        let near = Shape::Outline(vec![v(7.0, 0.9), v(9.0, 0.9), v(9.0, 2.0)]);
        let around = Shape::Outline(vec![v(-50.0, -50.0), v(50.0, -50.0), v(0.0, 50.0)]);
        assert!(corridor.touches(&near) && corridor.touches(&around) && !corridor.touches(&far));
    }

    #[test]
    fn paths_of_nuplan_end_a_state_earlier_and_are_trimmed_at_any_length() {
        let mut states = straight().states().to_vec();
        states.insert(5, states[5]);
        let kept = kept_states(&states);
        assert_eq!((kept.len(), kept[20].position), (21, v(20.0, 0.0)));
        let path = straight();
        let x = |part: Vec<Pose>| part.iter().map(|state| state.position.x).collect::<Vec<_>>();
        assert_eq!(x(path.trimmed(17.5, 19.0)), [17.5, 18.0, 19.0]);
        assert_eq!(x(path.trimmed(3.2, 3.4)), [3.2, 3.4]);
        assert_eq!(x(path.trimmed(-5.0, 1.0)), [0.0, 1.0]);
        assert_eq!(x(path.trimmed(-5.0, -2.0)), [0.0, 1.0]);
        assert_eq!(x(path.trimmed(21.0, 25.0)), [20.0, 20.5]);
        assert_eq!(x(path.from(19.0)), [19.0, 20.0, 20.5]);
        assert_eq!(x(path.from(30.0)), [20.0, 20.5]);
        assert_eq!(path.interpolated(-1.0).position, v(0.0, 0.0));
    }

    #[test]
    fn parallels_are_shifted_to_the_left() {
        let path = straight().aside(1.0).unwrap();
        assert!((path.at(7.3).position - v(7.3, 1.0)).norm() < 1e-12);
    }
}
