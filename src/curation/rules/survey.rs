//! What all draws of one scenario share: the logged drive, what the others do, where else the AV could go.

use super::routes::{self, Branch};
use crate::curation::ground::{Ground, lateral_acceleration};
use crate::curation::replay::LogReplay;
use crate::curation::signals::Signals;
use crate::dynamics::{AxlePath, follow_smoothly};
use crate::geometry::{Polyline, Vec2, wrap};
use crate::rollout::{AvError, LoggedDrive};
use crate::scene::{AgentState, CURRENT, DT, Road, Scenario};

/// Corners may leave the drivable ground by this, metres: a little less than the filter allows.
const OFF_ROAD: f64 = 0.25;
/// Lateral acceleration that a draw may show, m/s²: a little less than the filter allows.
const GRIP: f64 = 4.5;
/// A lane within this distance (metres) and angle (radians) tells its speed limit.
const UNDER: (f64, f64) = (3.0, 0.6);
/// An AV that drives less than this in the log stands, metres.
const STANDS: f64 = 2.0;
/// Lateral acceleration that a candidate takes, m/s².
pub(super) const LATERAL: f64 = 2.8;

pub(super) struct Survey<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) drive: LoggedDrive,
    pub(super) replay: LogReplay<'a>,
    /// The logged way at any speed.
    pub(super) logged: AxlePath,
    /// The same as the line of the box centre.
    line: Polyline,
    /// Other ways over the lane graph.
    pub(super) branches: Vec<Branch>,
    /// Lateral offsets of the lanes beside the logged way, metres, left positive.
    pub(super) beside: Vec<f64>,
    /// The highest speed that is asked for, m/s: the limit of the AV's lane, or the highest speed of its log.
    pub(super) limit: f64,
    /// Acceleration of the AV until now, m/s².
    acceleration: f64,
    /// The logged change of lanes, where there is one: the offset from the first lane by the way, metres, one per metre.
    pub(super) merge: Option<Vec<f64>>,
    /// Speed limits along the logged way, one per `Limits::STEP` metres.
    limits: Limits,
    /// Curvature of the rear axle's path now, 1/m.
    curvature: f64,
    ground: Ground<'a>,
    signals: Signals<'a>,
}

impl<'a> Survey<'a> {
    pub(super) fn new(scenario: &'a Scenario) -> Result<Self, AvError> {
        let drive = LoggedDrive::new(scenario)?;
        let road = scenario.start.road();
        let curvature = curvature_now(scenario, &drive);
        let top = drive.speeds().iter().fold(0.0_f64, |a, &v| a.max(v));
        let now = scenario.start.now(0);
        let limit = lane_limit(&road, now.position(), now.heading).map_or(top.max(8.0), |l| l.max(top));
        // Far enough for the fastest candidate.
        let reach = (8.0 * (top + 4.0).min(limit.max(top))).max(30.0);
        let mut logged = drive.path(scenario, None, Some(curvature), reach);
        logged.limit_lateral(LATERAL);
        let limits = Limits::along(&road, &logged, top);
        logged.limit_speed(|s| limits.at(s));
        let line = logged.centre_line();
        let (branches, beside) = if drive.reverses() {
            (Vec::new(), Vec::new())
        } else {
            (routes::branches(scenario, &line, curvature, reach), routes::beside(&road, &line))
        };
        Ok(Self {
            scenario,
            acceleration: acceleration_now(scenario),
            merge: routes::merge(scenario, &line),
            limits,
            replay: LogReplay::new(scenario),
            logged,
            line,
            branches,
            beside,
            limit,
            curvature,
            ground: Ground::new(scenario),
            signals: Signals::new(scenario),
            drive,
        })
    }

    /// Whether the logged AV drives at all.
    pub(super) fn moves(&self) -> bool {
        self.drive.speeds().iter().sum::<f64>() * DT > STANDS
    }

    /// Speed now, m/s.
    pub(super) fn speed(&self) -> f64 {
        self.drive.speeds()[0]
    }

    fn now(&self) -> AgentState {
        self.scenario.start.now(0)
    }

    /// Drives a path at the desired speeds.
    pub(super) fn follow(&self, path: &AxlePath, desired: &[f64]) -> Vec<AgentState> {
        follow_smoothly(self.now(), self.speed(), self.acceleration, path, desired)
    }

    /// The logged way moved sideways, with its limits.
    pub(super) fn aside(&self, aside: &dyn Fn(f64) -> f64, travel: f64) -> AxlePath {
        let mut path = self.drive.path(self.scenario, Some(aside), Some(self.curvature), travel);
        path.limit_lateral(LATERAL);
        path.limit_speed(|s| self.limits.at(s));
        path
    }

    /// How far a state lies beside the logged way, metres.
    pub(super) fn beside_way(&self, state: &AgentState) -> f64 {
        self.line.project(state.position()).distance
    }

    /// Mean distance to the logged AV, metres.
    pub(super) fn ade(&self, future: &[AgentState]) -> f64 {
        let log = &self.drive.states()[1..];
        let sum: f64 = future.iter().zip(log).map(|(a, b)| (a.position() - b.position()).norm()).sum();
        sum / future.len().max(1) as f64
    }

    pub(super) fn grips(&self, future: &[AgentState]) -> bool {
        lateral_acceleration(&self.now(), future) <= GRIP
    }

    pub(super) fn on_road(&self, future: &[AgentState]) -> bool {
        self.ground.depth(future, OFF_ROAD).is_none_or(|d| d <= OFF_ROAD)
    }

    pub(super) fn runs_red(&self, future: &[AgentState]) -> bool {
        self.signals.run(&self.now(), future).is_some()
    }
}

/// The curvature of the AV's way now by the logged headings around it, 1/m: over so long a time that it has moved a metre, 2 s at most; 0
/// for one that hardly moves.
fn curvature_now(scenario: &Scenario, drive: &LoggedDrive) -> f64 {
    let history = &scenario.start.history[0];
    for reach in [4, 7, CURRENT] {
        let (Some(before), after) = (history[CURRENT - reach], drive.states()[reach]) else { return 0.0 };
        let way = (after.position() - before.position()).norm();
        if way >= 1.0 {
            let sign = if drive.reverses() { -1.0 } else { 1.0 };
            return (sign * wrap(after.heading - before.heading) / way).clamp(-0.25, 0.25);
        }
    }
    0.0
}

/// The acceleration of the AV over the last half second, m/s²; 0 where it is not known.
fn acceleration_now(scenario: &Scenario) -> f64 {
    const REACH: usize = 5;
    let speed = |frame: usize| scenario.logged_velocity(0, frame).map(|v| v.norm());
    let (now, before) = (speed(CURRENT), speed(CURRENT - REACH));
    now.zip(before).map_or(0.0, |(a, b)| ((a - b) / (REACH as f64 * DT)).clamp(-4.0, 4.0))
}

/// Speed limits along a way.
pub(super) struct Limits(Vec<f64>);

impl Limits {
    /// Metres between two of them.
    const STEP: f64 = 5.0;

    /// The limits of the lanes under a way, m/s, but nowhere below `least`; no limit off the lanes and on lanes that tell none.
    pub(super) fn along(road: &Road<'_>, path: &AxlePath, least: f64) -> Self {
        let mut limits = Vec::new();
        for i in 0..path.poses() {
            let (pose, s) = path.pose(i);
            if s >= limits.len() as f64 * Self::STEP {
                let limit = lane_limit(road, pose.position, pose.heading);
                limits.push(limit.map_or(f64::INFINITY, |l| l.max(least)));
            }
        }
        Self(limits)
    }

    /// The limit after so many metres, m/s.
    pub(super) fn at(&self, s: f64) -> f64 {
        let i = (s / Self::STEP) as usize;
        self.0.get(i).or(self.0.last()).copied().unwrap_or(f64::INFINITY)
    }
}

/// The speed limit of the lane at a pose, m/s, where it is told.
fn lane_limit(road: &Road<'_>, p: Vec2, heading: f64) -> Option<f64> {
    road.lane(routes::lane_along(road, p, heading, UNDER)?.lane).speed_limit
}
