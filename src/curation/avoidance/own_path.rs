//! The path of an agent along its own log, and beyond its end.

use crate::geometry::{OrientedBox, Polyline, Vec2, direction, left, wrap};
use crate::scene::{Agent, AgentKind, AgentState, Frame};

/// Where an agent goes in its log, from the step at which it may leave it: positions with recorded headings by arc length. Beyond
/// the end it goes on straight.
#[derive(Clone, Debug)]
pub(super) struct OwnPath {
    line: Polyline,
    /// Heading at each point of the line, unwrapped.
    headings: Vec<f64>,
    /// Arc length at which the log ends.
    pub(super) end: f64,
    /// Sideways shift at its end, metres, left positive.
    pub(super) nudge: f64,
    /// Length over which it is reached, metres.
    ramp: f64,
    half_length: f64,
    half_width: f64,
}

/// Points of the log nearer to each other than this are jitter, metres.
const SPACING: f64 = 0.4;
/// How far a path goes on beyond the end of the log, metres.
const BEYOND: f64 = 200.0;

impl OwnPath {
    /// The path of `agent` through the logged frames from `start` on (`log[0]` is the frame of `start`).
    pub(super) fn new(agent: &Agent, start: &AgentState, log: &[Frame]) -> Option<Self> {
        let mut kept = vec![*start];
        for state in log.iter().flatten() {
            let last = kept[kept.len() - 1];
            if (state.position() - last.position()).norm() >= SPACING {
                kept.push(*state);
            }
        }
        let mut points: Vec<Vec2> = kept.iter().map(AgentState::position).collect();
        let mut headings = vec![start.heading];
        for state in &kept[1..] {
            let last = headings[headings.len() - 1];
            headings.push(last + wrap(state.heading - last));
        }
        let last = headings[headings.len() - 1];
        let onward = Self::onward(agent.kind, &points, last);
        let end = points[points.len() - 1];
        points.push(end + onward * BEYOND);
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

    /// The direction in which the agent goes on: that of its heading, or of its last steps where it does not go where it points.
    fn onward(kind: AgentKind, points: &[Vec2], heading: f64) -> Vec2 {
        let ahead = direction(heading);
        let [.., a, b] = points else { return ahead };
        let moved = (b - a).normalize();
        if kind != AgentKind::Pedestrian && moved.dot(&ahead) > 0.5 { ahead } else { moved }
    }

    /// The same path with a sideways shift that is reached over `ramp` metres.
    pub(super) fn nudged(&self, nudge: f64, ramp: f64) -> Self {
        Self { nudge, ramp, ..self.clone() }
    }

    /// Arc length of every logged frame from the start on. Frames without a state lie between their neighbours; at the end the
    /// agent keeps its last speed, `step` metres per frame.
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

    /// Position and heading at an arc length.
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
        let aside = self.nudge * crate::geometry::smooth_step(u);
        let slope = self.nudge / self.ramp * 30.0 * u * u * (1.0 - u) * (1.0 - u);
        (position + left(direction(heading)) * aside, wrap(heading + slope.atan()))
    }

    /// The box of the agent at an arc length.
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

    /// Boxes at the multiples of `spacing` up to `length`.
    pub(super) fn footprints(&self, spacing: f64, length: f64) -> Vec<OrientedBox> {
        let mut segment = 0;
        let count = (length / spacing).ceil() as usize + 1;
        let at = |i: usize| {
            let s = i as f64 * spacing;
            segment = self.line.segment_from(s, segment);
            self.footprint_on(s, segment)
        };
        (0..count).map(at).collect()
    }
}
