//! Log replay of all other agents, prepared for fast tests of many AV trajectories.

use std::f64::consts::PI;

use reactsim_geometry::{OrientedBox, math, rounded_distance, signed_angle_between};
use reactsim_metrics::{BEHIND_DEGREES, Options, STOPPED_SPEED};
use reactsim_scene::{Agent, AgentKind, AgentState, Scenario, Start};

/// Largest angle from the AV's heading at which a touched body is ahead of the AV, radians.
const AHEAD_ANGLE: f64 = 0.5;
/// Largest difference of headings that point in the same direction, radians.
const SAME_DIRECTION_ANGLE: f64 = 0.8;
/// Largest angle from the AV's heading at which a touched body is straight ahead, radians.
const STRAIGHT_AHEAD_ANGLE: f64 = 0.2;
/// Speed below which a body is crawling, m/s.
const CRAWLING_SPEED: f64 = 1.0;
/// Largest deviation from opposite headings that counts as head on, radians: less than in a turn across
/// the oncoming lane.
const HEAD_ON_ANGLE: f64 = 0.35;

/// The logged future of all agents but the AV, and the static obstacles, as boxes.
pub(super) struct LogReplay<'a> {
    av: &'a Agent,
    start: &'a Start,
    /// Corner radius of the boxes, as in the metrics, metres.
    rounding: f64,
    others: Vec<ReplayedBody>,
}

/// An agent or static obstacle under log replay.
struct ReplayedBody {
    /// `None` for static obstacles.
    kind: Option<AgentKind>,
    radius: f64,
    /// Box and speed (m/s, NaN if unknown) at the steps from 1 on.
    steps: Vec<Option<(OrientedBox, f64)>>,
    /// Height at the steps from 1 on, metres; empty in scenarios of one level.
    heights: Vec<f64>,
}

/// First contact of the AV with another body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Touch {
    /// Step, from 1.
    pub(super) step: usize,
    /// Kind of the other body; `None` for a static obstacle.
    pub(super) kind: Option<AgentKind>,
    /// Speed of the other body, m/s; 0 for obstacles.
    pub(super) speed: f64,
    /// Speed of the AV, m/s.
    pub(super) av_speed: f64,
    /// Whether the metrics would blame the other body (ignoring whether it is off the road).
    pub(super) at_fault: bool,
    /// Whether the AV's front bumper is inside the other box.
    pub(super) av_bumper: bool,
    /// Angle between the two headings, radians, 0 to pi.
    pub(super) turned: f64,
    /// Angle between the AV's heading and the direction to the other centre, radians, 0 to pi.
    pub(super) bearing: f64,
}

impl Touch {
    /// Returns whether the AV's front hits the rear of a body that moves in the same direction.
    pub(super) fn is_rear_end(&self) -> bool {
        self.av_bumper && self.bearing < AHEAD_ANGLE && self.turned < SAME_DIRECTION_ANGLE
    }

    /// Returns whether the AV's front hits an oncoming body: one straight ahead, or one ahead with
    /// exactly opposite heading.
    pub(super) fn is_head_on(&self) -> bool {
        let opposite = PI - self.turned;
        self.av_bumper
            && (self.bearing < STRAIGHT_AHEAD_ANGLE && opposite < SAME_DIRECTION_ANGLE
                || self.bearing < AHEAD_ANGLE && opposite < HEAD_ON_ANGLE)
    }

    /// Returns whether the AV's front hits a body that is slower than `slow` (m/s) and than the AV, or
    /// that the metrics would not blame.
    pub(super) fn is_driven_into(&self, slow: f64) -> bool {
        self.av_bumper && (!self.at_fault || self.speed < slow.min(self.av_speed))
    }

    /// Returns whether the other body is at rest.
    pub(super) fn is_standing(&self) -> bool {
        self.speed <= STOPPED_SPEED
    }

    /// Returns whether the other body hardly moves, and less than the AV: in any contact with it, the AV
    /// came to it.
    pub(super) fn is_crawling(&self) -> bool {
        self.speed < CRAWLING_SPEED && self.speed < self.av_speed
    }
}

impl<'a> LogReplay<'a> {
    pub(super) fn new(scenario: &'a Scenario) -> Self {
        let (start, length) = (&scenario.start, scenario.length());
        let mut others = Vec::with_capacity(start.agents.len() + start.obstacles.len());
        for (i, agent) in start.agents.iter().enumerate().skip(1) {
            let speed =
                |k: usize| scenario.logged_velocity(i, length.history + k).map_or(f64::NAN, |v| v.norm());
            let future = scenario.log_future.tracks[i].iter().enumerate();
            let steps = future.map(|(k, f)| f.map(|s| (s.footprint(agent), speed(k)))).collect();
            let radius = math::hypot(0.5 * agent.length, 0.5 * agent.width);
            let heights = start.heights_along(i, &scenario.logged(i)[length.current()..]);
            let heights = heights.get(1..).unwrap_or_default().to_vec();
            others.push(ReplayedBody { kind: Some(agent.kind), radius, steps, heights });
        }
        for (i, obstacle) in start.obstacles.iter().enumerate() {
            let steps = vec![Some((*obstacle, 0.0)); length.future];
            let known = if start.has_levels() { length.future } else { 0 };
            let heights = vec![start.obstacle_height(i); known];
            others.push(ReplayedBody { kind: None, radius: obstacle.radius(), steps, heights });
        }
        Self { av: &start.agents[0], start, rounding: Options::default().corner_rounding, others }
    }

    /// Returns the first contact with every body that the AV touches on `future` (states at the steps
    /// from 1 on), in the order of the agents.
    pub(super) fn touches(&self, future: &[AgentState]) -> Vec<Touch> {
        let boxes: Vec<OrientedBox> = future.iter().map(|s| s.footprint(self.av)).collect();
        let radius = boxes.first().map_or(0.0, OrientedBox::radius);
        let (road, heights) = (self.start.road(), self.start.heights_on_way(0, future));
        let mut touches = Vec::new();
        for other in &self.others {
            let reach = (radius + other.radius) * (radius + other.radius);
            let apart = |k: usize, o: &OrientedBox| {
                let pair = heights.get(k).zip(other.heights.get(k));
                pair.is_some_and(|(a, b)| road.is_apart((boxes[k].center, *a), (o.center, *b)))
            };
            let first = boxes.iter().zip(&other.steps).enumerate().position(|(k, (av, step))| {
                step.is_some_and(|(o, _)| {
                    (o.center - av.center).norm_squared() <= reach
                        && !apart(k, &o)
                        && rounded_distance(&o, av, self.rounding) < 0.0
                })
            });
            let Some(k) = first else { continue };
            if let Some((other_box, speed)) = other.steps[k] {
                touches.push(judge(&boxes[k], future[k].speed(), &other_box, speed, other.kind, k + 1));
            }
        }
        touches
    }
}

fn judge(
    av: &OrientedBox,
    av_speed: f64,
    other: &OrientedBox,
    speed: f64,
    kind: Option<AgentKind>,
    step: usize,
) -> Touch {
    let to_av = av.center - other.center;
    let behind = signed_angle_between(other.axis, to_av).abs() > BEHIND_DEGREES.to_radians();
    let [front_left, front_right, ..] = other.corners();
    let at_fault = kind == Some(AgentKind::Vehicle)
        && !(speed <= STOPPED_SPEED)
        && !behind
        && (av_speed <= STOPPED_SPEED || av.intersects_segment(front_left, front_right));
    let [av_left, av_right, ..] = av.corners();
    Touch {
        step,
        kind,
        speed,
        av_speed,
        at_fault,
        av_bumper: other.intersects_segment(av_left, av_right),
        turned: signed_angle_between(av.axis, other.axis).abs(),
        bearing: signed_angle_between(av.axis, -to_av).abs(),
    }
}
