//! The path of an agent along its own log, and beyond the end of the log.

use reactsim_geometry::{OrientedBox, Polyline, Vec2, direction, left, math, wrap};
use reactsim_scene::{Agent, AgentKind, AgentState, Frame};

/// Logged path of an agent from the step at which it may leave the log: positions with recorded headings
/// by arc length. It is extended straight beyond its end.
#[derive(Clone, Debug)]
pub(super) struct OwnPath {
    line: Polyline,
    /// Heading at each point of the line, unwrapped.
    headings: Vec<f64>,
    /// Arc length at which the log ends.
    pub(super) end: f64,
    /// Lateral shift at the end of the ramp, metres, left positive.
    pub(super) nudge: f64,
    /// Length over which the shift is reached, metres.
    ramp: f64,
    half_length: f64,
    half_width: f64,
}

/// Smallest distance between logged points, metres: closer ones are jitter.
const MIN_POINT_SPACING: f64 = 0.4;
/// Length of the straight segment beyond the end of the log, metres. The path can be evaluated beyond
/// that too; other code limits how far an agent may travel.
const EXTENSION_LENGTH: f64 = 200.0;

impl OwnPath {
    /// Builds the path of `agent` through the logged frames from `start` on (`log[0]` is the frame of
    /// `start`).
    pub(super) fn new(agent: &Agent, start: &AgentState, log: &[Frame]) -> Option<Self> {
        let mut states = vec![*start];
        for state in log.iter().flatten() {
            let last = states[states.len() - 1];
            if (state.position() - last.position()).norm() >= MIN_POINT_SPACING {
                states.push(*state);
            }
        }
        let mut points: Vec<Vec2> = states.iter().map(AgentState::position).collect();
        let mut headings = vec![start.heading];
        for state in &states[1..] {
            let last = headings[headings.len() - 1];
            headings.push(last + wrap(state.heading - last));
        }
        let last = headings[headings.len() - 1];
        let onward = Self::onward(agent.kind, &points, last);
        let end = points[points.len() - 1];
        points.push(end + onward * EXTENSION_LENGTH);
        headings.push(last);
        let line = Polyline::new(&points).ok()?;
        let end = line.arc()[line.arc().len() - 2];
        Some(Self {
            line,
            headings,
            end,
            nudge: 0.0,
            ramp: 1.0,
            half_length: 0.5 * agent.length,
            half_width: 0.5 * agent.width,
        })
    }

    /// Returns the direction of the extension: that of the heading, or that of the last steps if the
    /// agent does not move where it points.
    fn onward(kind: AgentKind, points: &[Vec2], heading: f64) -> Vec2 {
        let ahead = direction(heading);
        let [.., a, b] = points else { return ahead };
        let moved = (b - a).normalize();
        if kind != AgentKind::Pedestrian && moved.dot(&ahead) > 0.5 { ahead } else { moved }
    }

    /// Returns the same path with a lateral shift that is reached over `ramp` metres.
    pub(super) fn nudged(&self, nudge: f64, ramp: f64) -> Self {
        Self { nudge, ramp, ..self.clone() }
    }

    /// Returns the arc length of every logged frame from the start on. Frames without a state are
    /// interpolated; after the end of the log the agent advances by `step` metres per frame.
    pub(super) fn arc_lengths(&self, log: &[Frame], step: f64) -> Vec<f64> {
        let mut found: Vec<f64> = Vec::with_capacity(log.len());
        let (mut segment, mut s) = (0, 0.0_f64);
        let mut seen = 0;
        for (k, frame) in log.iter().enumerate() {
            match frame {
                Some(state) => {
                    let here = self.line.project_between(state.position(), segment, segment + 4);
                    segment = here.segment;
                    let before = s;
                    s = s.max(here.s);
                    let missing = k - seen;
                    for (m, value) in found.iter_mut().enumerate().skip(seen + 1) {
                        *value = before + (s - before) * (m - seen) as f64 / missing as f64;
                    }
                    seen = k;
                    found.push(s);
                }
                None => found.push(s + step * (k - seen) as f64),
            }
        }
        found
    }

    /// Returns position and heading at an arc length.
    pub(super) fn pose(&self, s: f64) -> (Vec2, f64) {
        self.pose_on(s, self.line.segment_at(s))
    }

    fn pose_on(&self, s: f64, segment: usize) -> (Vec2, f64) {
        let arc = self.line.arc();
        let share = ((s - arc[segment]) / (arc[segment + 1] - arc[segment])).clamp(0.0, 1.0);
        let heading = self.headings[segment] + (self.headings[segment + 1] - self.headings[segment]) * share;
        let position = self.line.on_segment(s, segment);
        if self.nudge == 0.0 {
            return (position, wrap(heading));
        }
        let u = (s / self.ramp).clamp(0.0, 1.0);
        let aside = self.nudge * reactsim_geometry::smooth_step(u);
        let slope = self.nudge / self.ramp * 30.0 * u * u * (1.0 - u) * (1.0 - u);
        (position + left(direction(heading)) * aside, wrap(heading + math::atan(slope)))
    }

    /// Returns the box of the agent at an arc length.
    pub(super) fn footprint(&self, s: f64) -> OrientedBox {
        self.footprint_on(s, self.line.segment_at(s))
    }

    fn footprint_on(&self, s: f64, segment: usize) -> OrientedBox {
        let (center, heading) = self.pose_on(s, segment);
        OrientedBox {
            center,
            axis: direction(heading),
            half_length: self.half_length,
            half_width: self.half_width,
        }
    }

    /// Like [`Self::footprint`], for an arc length on or shortly after a segment.
    pub(super) fn footprint_near(&self, s: f64, segment: usize) -> OrientedBox {
        self.footprint_on(s, self.line.segment_from(s, segment))
    }

    /// Returns the headings at the multiples 0 to `count` of `spacing`.
    pub(super) fn headings(&self, spacing: f64, count: usize) -> Vec<f64> {
        let mut segment = 0;
        let at = |i: usize| {
            let s = i as f64 * spacing;
            segment = self.line.segment_from(s, segment);
            self.pose_on(s, segment).1
        };
        (0..=count).map(at).collect()
    }

    /// Returns the boxes at the multiples of `spacing` up to `length`, with their path segments.
    pub(super) fn footprints(&self, spacing: f64, length: f64) -> (Vec<OrientedBox>, Vec<usize>) {
        let mut segment = 0;
        let count = (length / spacing).ceil() as usize + 1;
        let at = |i: usize| {
            let s = i as f64 * spacing;
            segment = self.line.segment_from(s, segment);
            (self.footprint_on(s, segment), segment)
        };
        (0..count).map(at).unzip()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn car() -> Agent {
        Agent { id: "a".to_owned(), kind: AgentKind::Vehicle, length: 4.0, width: 2.0 }
    }

    fn state(x: f64, y: f64, heading: f64) -> AgentState {
        AgentState { x, y, heading, vx: 0.0, vy: 0.0 }
    }

    #[test]
    fn a_stationary_agent_with_jitter_extends_along_its_heading() {
        let jitter = |k: usize| Some(state(0.02 * (k % 3) as f64, -0.03 * (k % 2) as f64, 1.0));
        let log: Vec<Frame> = (0..80).map(jitter).collect();
        let path = OwnPath::new(&car(), &state(0.0, 0.0, 1.0), &log).unwrap();
        assert_eq!(path.end, 0.0);
        let (p, heading) = path.pose(10.0);
        assert!((p - direction(1.0) * 10.0).norm() < 1e-9 && (heading - 1.0).abs() < 1e-12);
        assert!(path.arc_lengths(&log, 0.0).iter().all(|s| *s < 0.06));
    }

    #[test]
    fn headings_are_those_recorded_and_gaps_are_bridged() {
        let mut log: Vec<Frame> =
            (0..40).map(|k| Some(state(f64::from(k), 0.0, 3.1 + 0.01 * f64::from(k)))).collect();
        let mut backwards = log.clone();
        (log[5], log[6]) = (None, None);
        log.truncate(30);
        log.extend([None, None]);
        let path = OwnPath::new(&car(), &log[0].unwrap(), &log).unwrap();
        let arcs = path.arc_lengths(&log, 0.7);
        assert!((arcs[5] - 5.0).abs() < 1e-9 && (arcs[6] - 6.0).abs() < 1e-9, "{arcs:?}");
        assert!((arcs[31] - (29.0 + 1.4)).abs() < 1e-9, "{arcs:?}");
        // Across the wrap of the angle, and never the other way round.
        assert!((path.pose(10.5).1 - wrap(3.205)).abs() < 1e-9);
        backwards.reverse();
        let path = OwnPath::new(&car(), &backwards[0].unwrap(), &backwards).unwrap();
        assert!((path.pose(5.0).0 - Vec2::new(34.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_shift_is_reached_smoothly_and_kept() {
        let log: Vec<Frame> = (0..40).map(|k| Some(state(f64::from(k), 0.0, 0.0))).collect();
        let path = OwnPath::new(&car(), &log[0].unwrap(), &log).unwrap().nudged(-1.0, 10.0);
        assert_eq!(path.pose(0.0), (Vec2::zeros(), 0.0));
        assert!((path.pose(5.0).0.y + 0.5).abs() < 1e-9 && path.pose(5.0).1 < -0.15);
        assert!((path.pose(30.0).0 - Vec2::new(30.0, -1.0)).norm() < 1e-9);
        assert!(path.pose(30.0).1.abs() < 1e-12);
    }
}
