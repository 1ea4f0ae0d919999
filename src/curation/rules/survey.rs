//! What all draws of one scenario share: the logged drive, what the others do, where else the AV could go.

use super::routes::{self, Branch};
use crate::curation::ground::Ground;
use crate::curation::replay::LogReplay;
use crate::curation::signals::Signals;
use crate::dynamics::{AxlePath, follow};
use crate::geometry::{Polyline, wrap};
use crate::rollout::{AvError, LoggedDrive};
use crate::scene::{AgentState, CURRENT, DT, LaneHit, Road, Scenario};

/// Corners may leave the drivable ground by this, metres: a little less than the filter allows.
const OFF_ROAD: f64 = 0.25;
/// An AV that drives less than this in the log stands, metres.
const STANDS: f64 = 2.0;
/// Over how many steps before and after now the curvature is taken.
const REACH: usize = 4;
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
    /// The highest speed that is taken, m/s.
    pub(super) limit: f64,
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
        let limit = speed_limit(&road, scenario).map_or(top.max(8.0), |l| (1.1 * l).max(top));
        // Far enough for the fastest candidate.
        let reach = (8.0 * (top + 4.0).min(limit.max(top))).max(30.0);
        let mut logged = drive.path(scenario, None, Some(curvature), reach);
        logged.limit_lateral(LATERAL);
        let line = logged.centre_line();
        let (branches, beside) = if drive.reverses() {
            (Vec::new(), Vec::new())
        } else {
            (routes::branches(scenario, &line, curvature, reach), routes::beside(&road, &line))
        };
        Ok(Self {
            scenario,
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
        follow(self.now(), self.speed(), path, desired)
    }

    /// The logged way moved sideways, with its limits.
    pub(super) fn aside(&self, aside: &dyn Fn(f64) -> f64, travel: f64) -> AxlePath {
        let mut path = self.drive.path(self.scenario, Some(aside), Some(self.curvature), travel);
        path.limit_lateral(LATERAL);
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

    pub(super) fn on_road(&self, future: &[AgentState]) -> bool {
        self.ground.depth(future, OFF_ROAD).is_none_or(|d| d <= OFF_ROAD)
    }

    pub(super) fn runs_red(&self, future: &[AgentState]) -> bool {
        self.signals.run(&self.now(), future).is_some()
    }
}

/// The curvature of the AV's way now by the logged headings around it, 1/m; 0 for one that hardly moves.
fn curvature_now(scenario: &Scenario, drive: &LoggedDrive) -> f64 {
    let history = &scenario.start.history[0];
    let (Some(before), after) = (history[CURRENT - REACH], drive.states()[REACH]) else { return 0.0 };
    let way = (after.position() - before.position()).norm();
    if way < 1.0 {
        return 0.0;
    }
    let sign = if drive.reverses() { -1.0 } else { 1.0 };
    (sign * wrap(after.heading - before.heading) / way).clamp(-0.25, 0.25)
}

/// The speed limit of the lane under the AV, m/s.
fn speed_limit(road: &Road<'_>, scenario: &Scenario) -> Option<f64> {
    let now = scenario.start.now(0);
    let mut hits: Vec<LaneHit> = Vec::new();
    road.lanes_near(now.position(), 3.0, &mut hits);
    let off =
        |h: &LaneHit| wrap(road.lane(h.lane).baseline.heading(h.projection.segment) - now.heading).abs();
    let best = hits.iter().filter(|h| off(h) < 0.6).min_by(|a, b| {
        let cost = |h: &LaneHit| h.projection.distance + 2.0 * off(h);
        cost(a).total_cmp(&cost(b))
    })?;
    road.lane(best.lane).speed_limit
}
