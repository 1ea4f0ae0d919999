//! Violations of traffic lights: an object crosses the stop point of its lane while the light is red.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_scene::{CURRENT, FRAMES, FUTURE, HISTORY, LightState, wosac::WosacLog};

use super::objects::Motion;

/// Lanes and signals of a scenario.
pub(super) struct TrafficLights {
    lanes: Vec<Lane>,
    signals: Vec<Signal>,
}

/// The segments of a lane of a surface street.
struct Lane {
    id: i64,
    segments: Vec<Segment>,
    /// Smallest and largest coordinates of the starts of the segments, metres.
    bounds: [[f64; 2]; 2],
}

#[derive(Clone, Copy)]
struct Segment {
    start: [f64; 2],
    edge: [f64; 2],
    length_squared: f64,
}

/// The signal of a lane at the frames 10 to 90.
struct Signal {
    /// Index of the lane.
    lane: usize,
    frames: Vec<SignalFrame>,
}

/// A signal at one frame.
#[derive(Clone, Copy)]
struct SignalFrame {
    is_red: bool,
    /// Segment along which positions are compared.
    reference: Segment,
    /// Position of the stop point along the reference segment: 0 at its start, 1 at its end.
    stop: f64,
}

impl Segment {
    fn new(start: [f64; 2], end: [f64; 2]) -> Self {
        let edge = [end[0] - start[0], end[1] - start[1]];
        Self { start, edge, length_squared: edge[0] * edge[0] + edge[1] * edge[1] }
    }

    /// Returns the position of a point along the segment: 0 at its start, 1 at its end; 0 without a length.
    fn along(&self, point: [f64; 2]) -> f64 {
        let d = [point[0] - self.start[0], point[1] - self.start[1]];
        let along = d[0] * self.edge[0] + d[1] * self.edge[1];
        if self.length_squared > 0.0 { along / self.length_squared } else { 0.0 }
    }

    /// Returns the squared pseudo-distance by which the official code finds the nearest lane. It adds the
    /// projection to the vector from the start where a distance would subtract it, so that the nearest start
    /// ahead wins.
    fn pseudo_distance_squared(&self, point: [f64; 2]) -> f64 {
        let t = self.along(point).clamp(0.0, 1.0);
        let q = [0, 1].map(|axis| point[axis] - self.start[axis] + t * self.edge[axis]);
        q[0] * q[0] + q[1] * q[1]
    }
}

impl Lane {
    /// Makes the segments of a lane. A lane with fewer points than the longest one has another segment, from
    /// its last point to the origin of the world, as in the official code.
    fn new(id: i64, points: &[[f32; 2]], most_points: usize) -> Self {
        let mut points: Vec<[f64; 2]> = points.iter().map(|p| p.map(f64::from)).collect();
        let mut bounds = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for point in &points {
            for axis in [0, 1] {
                bounds[0][axis] = bounds[0][axis].min(point[axis]);
                bounds[1][axis] = bounds[1][axis].max(point[axis]);
            }
        }
        if points.len() < most_points {
            points.push([0.0, 0.0]);
        }
        let segments = points.windows(2).map(|ends| Segment::new(ends[0], ends[1])).collect();
        Self { id, segments, bounds }
    }

    /// Returns the segment with the smallest pseudo-distance, the first on ties, and the square of it.
    fn nearest(&self, point: [f64; 2]) -> (Segment, f64) {
        let mut nearest = (self.segments[0], f64::INFINITY);
        for segment in &self.segments {
            let distance = segment.pseudo_distance_squared(point);
            if distance < nearest.1 {
                nearest = (*segment, distance);
            }
        }
        nearest
    }

    /// Returns a lower bound of the squared pseudo-distance, which is at least the distance to the start of a
    /// segment.
    fn bound_squared(&self, point: [f64; 2]) -> f64 {
        let outside =
            [0, 1].map(|i| (self.bounds[0][i] - point[i]).max(point[i] - self.bounds[1][i]).max(0.0));
        outside[0] * outside[0] + outside[1] * outside[1]
    }
}

impl TrafficLights {
    /// Prepares the lanes and signals of a log with a future.
    pub(super) fn new(log: &WosacLog) -> Self {
        let most_points = log.surface_lanes.iter().map(|lane| lane.points.len()).max().unwrap_or(0);
        let with_segments = log.surface_lanes.iter().filter(|lane| lane.points.len() >= 2);
        let lanes: Vec<Lane> =
            with_segments.map(|lane| Lane::new(lane.id, &lane.points, most_points)).collect();
        let mut indices = BTreeMap::new();
        for (i, lane) in lanes.iter().enumerate() {
            indices.entry(lane.id).or_insert(i);
        }
        let controlled: BTreeSet<i64> = log.signals.iter().flatten().map(|signal| signal.lane).collect();
        let signals = controlled.into_iter().filter_map(|id| Some((id, *indices.get(&id)?)));
        let signals = signals.map(|(id, lane)| Signal::new(log, id, lane, &lanes[lane]));
        Self { signals: signals.collect(), lanes }
    }

    /// Returns at which of the steps 1 to 80 an evaluated object violates a light.
    pub(super) fn violations(&self, motion: &Motion, object: usize) -> [bool; FUTURE] {
        let mut violations = [false; FUTURE];
        if self.signals.is_empty() {
            return violations;
        }
        let future = &motion.futures[object];
        for (k, violation) in violations.iter_mut().enumerate() {
            let before = motion.before(object, k).map(f64::from);
            let now = [f64::from(future.x[k]), f64::from(future.y[k])];
            *violation = motion.is_valid(object, k)
                && self.signals.iter().any(|signal| {
                    let [first, second] = [signal.frames[k], signal.frames[k + 1]];
                    second.is_red
                        && first.reference.along(before) < first.stop
                        && second.reference.along(now) > second.stop
                        && self.is_nearest(signal.lane, now)
                });
        }
        violations
    }

    /// Returns whether a lane is the nearest one to a point by pseudo-distance; the first one wins on ties.
    fn is_nearest(&self, lane: usize, point: [f64; 2]) -> bool {
        let own = self.lanes[lane].nearest(point).1;
        // Rounding of the bound must not exclude a lane.
        let limit = own * (1.0 + 1e-9) + 1e-9;
        self.lanes.iter().enumerate().all(|(i, other)| {
            i == lane || other.bound_squared(point) > limit || {
                let theirs = other.nearest(point).1;
                own < theirs || (own == theirs && lane < i)
            }
        })
    }
}

impl Signal {
    fn new(log: &WosacLog, id: i64, index: usize, lane: &Lane) -> Self {
        let mut known: Option<([f32; 2], Segment)> = None;
        let frame = |frame: usize| {
            // The last entry counts; an absent signal has state 0 and its stop point at the origin.
            let entry = log.signals[frame].iter().rev().find(|signal| signal.lane == id);
            let stop_point = entry.map_or([0.0; 2], |signal| signal.stop_point);
            let reference = match known {
                Some((point, reference)) if point == stop_point => reference,
                _ => lane.nearest(stop_point.map(f64::from)).0,
            };
            known = Some((stop_point, reference));
            let red = [LightState::ArrowStop, LightState::Stop].map(|state| i32::from(state.code()));
            SignalFrame {
                is_red: entry.is_some_and(|signal| red.contains(&signal.state)),
                reference,
                stop: reference.along(stop_point.map(f64::from)),
            }
        };
        const { assert!(CURRENT + 1 == HISTORY) };
        Self { lane: index, frames: (CURRENT..FRAMES).map(frame).collect() }
    }
}
