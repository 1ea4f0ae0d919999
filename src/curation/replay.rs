//! What everybody else does under log replay, laid out so that many AV trajectories can be held against it quickly.

use std::f64::consts::PI;

use crate::geometry::{OrientedBox, math, rounded_distance, signed_angle_between};
use crate::metrics::{BEHIND_DEGREES, Options, STOPPED_SPEED};
use crate::scene::{Agent, AgentKind, AgentState, FUTURE, HISTORY, Scenario};

/// Who is touched in this angle of the AV's heading is ahead of it, radians.
const AHEAD: f64 = 0.5;
/// Headings within this angle lead the same way, radians.
const ALONG: f64 = 0.8;
/// Who is touched in this angle is straight ahead, radians.
const STRAIGHT_AHEAD: f64 = 0.2;
/// Slower than this is crawling, m/s.
const CRAWLING: f64 = 1.0;
/// Headings within this angle of opposite ones lead head on, radians: less than that of a turn across the oncoming lane.
const HEAD_ON: f64 = 0.35;

/// The logged future of all agents but the AV, and the static obstacles, as boxes.
pub(super) struct LogReplay<'a> {
    av: &'a Agent,
    /// How far corners are rounded: as the metrics do it.
    rounding: f64,
    others: Vec<Other>,
}

struct Other {
    /// `None` for static obstacles.
    kind: Option<AgentKind>,
    radius: f64,
    /// Per step 1 to 80 the box, and the speed, m/s (NaN where unknown).
    steps: Vec<Option<(OrientedBox, f64)>>,
}

/// The first contact of the AV with somebody.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Touch {
    /// Step, 1 to 80.
    pub(super) step: usize,
    /// Class of the other; `None` for a static obstacle.
    pub(super) kind: Option<AgentKind>,
    /// Speed of the other, m/s; 0 for obstacles.
    pub(super) speed: f64,
    /// Speed of the AV, m/s.
    pub(super) av_speed: f64,
    /// Whether the metrics would blame the other one (but for ground off the road).
    pub(super) at_fault: bool,
    /// Whether the AV's front bumper is in the other one's box.
    pub(super) av_bumper: bool,
    /// Angle between the two headings, radians, 0 to pi.
    pub(super) turned: f64,
    /// Angle between the AV's heading and the direction to the other one's centre, radians, 0 to pi.
    pub(super) bearing: f64,
}

impl Touch {
    /// Whether the AV's front drives into the rear of somebody who goes the same way.
    pub(super) fn rear_end(&self) -> bool {
        self.av_bumper && self.bearing < AHEAD && self.turned < ALONG
    }

    /// Whether the AV's front drives into somebody who comes towards it: straight ahead, or at least exactly the other way.
    pub(super) fn head_on(&self) -> bool {
        let opposite = PI - self.turned;
        self.av_bumper
            && (self.bearing < STRAIGHT_AHEAD && opposite < ALONG
                || self.bearing < AHEAD && opposite < HEAD_ON)
    }

    /// Whether the AV's front drives into somebody who is slower than `slow` (m/s) and than the AV, or whom the metrics would not blame.
    pub(super) fn driven_into(&self, slow: f64) -> bool {
        self.av_bumper && (!self.at_fault || self.speed < slow.min(self.av_speed))
    }

    /// Whether the other one stands.
    pub(super) fn stands(&self) -> bool {
        self.speed <= STOPPED_SPEED
    }

    /// Whether the other one hardly moves, and less than the AV: wherever they touch, the AV came to it.
    pub(super) fn crawls(&self) -> bool {
        self.speed < CRAWLING && self.speed < self.av_speed
    }
}

impl<'a> LogReplay<'a> {
    pub(super) fn new(scenario: &'a Scenario) -> Self {
        let start = &scenario.start;
        let mut others = Vec::with_capacity(start.agents.len() + start.obstacles.len());
        for (i, agent) in start.agents.iter().enumerate().skip(1) {
            let speed = |k: usize| scenario.logged_velocity(i, HISTORY + k).map_or(f64::NAN, |v| v.norm());
            let future = scenario.log_future.tracks[i].iter().enumerate();
            let steps = future.map(|(k, f)| f.map(|s| (s.footprint(agent), speed(k)))).collect();
            let radius = math::hypot(0.5 * agent.length, 0.5 * agent.width);
            others.push(Other { kind: Some(agent.kind), radius, steps });
        }
        for obstacle in &start.obstacles {
            let steps = vec![Some((*obstacle, 0.0)); FUTURE];
            others.push(Other { kind: None, radius: obstacle.radius(), steps });
        }
        Self { av: &start.agents[0], rounding: Options::default().corner_rounding, others }
    }

    /// The first contact with everybody whom the AV touches on `future` (states at the steps 1 to 80), in the order of the agents.
    pub(super) fn touches(&self, future: &[AgentState]) -> Vec<Touch> {
        let boxes: Vec<OrientedBox> = future.iter().map(|s| s.footprint(self.av)).collect();
        let radius = boxes.first().map_or(0.0, OrientedBox::radius);
        let mut touches = Vec::new();
        for other in &self.others {
            let reach = (radius + other.radius) * (radius + other.radius);
            let first = boxes.iter().zip(&other.steps).position(|(av, step)| {
                step.is_some_and(|(o, _)| {
                    (o.center - av.center).norm_squared() <= reach
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
