//! Precomputed data that all draws of one scenario share: the logged drive, the motion of others, other
//! routes of the AV.

use reactsim_geometry::{Polyline, Vec2, direction, wrap};
use reactsim_rollout::{AvError, LoggedDrive};
use reactsim_scene::dynamics::{AxlePath, follow_smoothly};
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Scenario};

use super::limits::{Limits, MAX_LATERAL_ACCELERATION, lane_limit};
use super::routes::{self, Branch, PathEntry};
use crate::ground::{Ground, lateral_acceleration};
use crate::replay::LogReplay;
use crate::signals::Signals;

/// Distance by which corners may leave the drivable area, metres: slightly less than the filter allows.
const OFF_ROAD_TOLERANCE: f64 = 0.25;
/// Largest lateral acceleration of an accepted draw, m/s²: slightly less than the filter allows.
const GRIP_ACCELERATION: f64 = 4.5;
/// Distance driven in the log below which an AV is stationary, metres.
const STATIONARY_DISTANCE: f64 = 2.0;
/// Precomputed data of one scenario.
pub(super) struct Survey<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) drive: LoggedDrive,
    pub(super) replay: LogReplay<'a>,
    /// Logged path, for any speed.
    pub(super) logged: AxlePath,
    /// Line of the box centre on that path.
    line: Polyline,
    /// Other routes over the lane graph.
    pub(super) branches: Vec<Branch>,
    /// Lateral offsets of the lanes adjacent to the logged path, metres, left positive.
    pub(super) adjacent_lanes: Vec<f64>,
    /// Largest desired speed, m/s: the limit of the AV's lane, or the highest speed of its log.
    pub(super) limit: f64,
    /// Current acceleration of the AV, m/s².
    acceleration: f64,
    /// Logged lane change, if any: the offset from the first lane, metres, at every metre of the path.
    pub(super) merge: Option<Vec<f64>>,
    /// Speed limits along the logged path, one per [`Limits::SPACING`] metres.
    limits: Limits,
    /// Entries of others onto the logged path under log replay.
    path_entries: Vec<PathEntry>,
    /// Logged motion of the other vehicles along the logged path.
    pub(super) neighbors: Vec<Neighbor>,
    /// Current curvature of the rear-axle path, 1/m.
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
        let reach = (scenario.length().future as f64 * DT * (top + 4.0).min(limit.max(top))).max(30.0);
        let mut logged = drive.path(scenario, None, Some(curvature), reach);
        logged.limit_lateral(MAX_LATERAL_ACCELERATION);
        let limits = Limits::along(&road, &logged, top);
        logged.limit_speed(|s| limits.at(s));
        let line = logged.centre_line();
        let (branches, adjacent_lanes) = if drive.reverses() {
            (Vec::new(), Vec::new())
        } else {
            (routes::branches(scenario, &line, curvature, reach), routes::adjacent_lanes(&road, &line))
        };
        let path_entries = routes::path_entries(scenario, &logged);
        Ok(Self {
            scenario,
            acceleration: acceleration_now(scenario),
            merge: routes::merge(scenario, &line),
            limits,
            replay: LogReplay::new(scenario),
            logged,
            path_entries,
            neighbors: neighbors(scenario, &line),
            line,
            branches,
            adjacent_lanes,
            limit,
            curvature,
            ground: Ground::new(scenario),
            signals: Signals::new(scenario),
            drive,
        })
    }

    /// Returns whether the logged AV moves at all.
    pub(super) fn is_moving(&self) -> bool {
        self.drive.speeds().iter().sum::<f64>() * DT > STATIONARY_DISTANCE
    }

    /// Returns whether other vehicles pass next to the logged path, so that a stationary AV could pull
    /// out in front of them.
    pub(super) fn can_pull_out(&self) -> bool {
        let passes =
            |n: &Neighbor| n.positions.iter().flatten().any(|p| p.speed > 2.0 && p.offset.abs() > 1.5);
        !self.drive.reverses() && self.neighbors.iter().any(passes)
    }

    /// Returns the entries of others onto the logged path that happen while the logged AV has not
    /// reached that point yet.
    pub(super) fn entries_before_av(&self) -> Vec<PathEntry> {
        let states = self.drive.states();
        let before = |m: &PathEntry| {
            let step = ((m.time / DT) as usize).min(self.steps());
            self.line.project(states[step].position()).s + self.half_length() < m.s
        };
        self.path_entries.iter().copied().filter(before).collect()
    }

    pub(super) fn steps(&self) -> usize {
        self.drive.states().len() - 1
    }

    /// Returns half of the AV's length, metres.
    pub(super) fn half_length(&self) -> f64 {
        0.5 * self.scenario.start.agents[0].length
    }

    /// Returns the current speed, m/s.
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

    /// Returns the logged path shifted sideways, with its speed limits.
    pub(super) fn shifted_path(&self, aside: &dyn Fn(f64) -> f64, travel: f64) -> AxlePath {
        let mut path = self.drive.path(self.scenario, Some(aside), Some(self.curvature), travel);
        path.limit_lateral(MAX_LATERAL_ACCELERATION);
        path.limit_speed(|s| self.limits.at(s));
        path
    }

    /// Returns whether a vehicle follows the logged AV within two seconds, or 8 m, at `after` seconds.
    pub(super) fn is_followed_closely(&self, after: f64) -> bool {
        let step = ((after / DT) as usize).min(self.steps());
        let step = step / Neighbor::SAMPLE_STEPS * Neighbor::SAMPLE_STEPS;
        let own = self.line.project(self.drive.states()[step].position()).s;
        self.neighbors.iter().filter_map(|n| Some((n.half_length, n.at(step)?))).any(|(half_length, p)| {
            let gap = own - self.half_length() - p.s - half_length;
            p.offset.abs() < 1.5 && p.speed > 1.0 && gap > 0.0 && gap < (2.0 * p.speed).max(8.0)
        })
    }

    /// Returns the distance of a state from the logged path, metres.
    pub(super) fn distance_to_logged(&self, state: &AgentState) -> f64 {
        self.line.project(state.position()).distance
    }

    /// Returns the mean distance to the logged AV, metres.
    pub(super) fn ade(&self, future: &[AgentState]) -> f64 {
        let log = &self.drive.states()[1..];
        let sum: f64 = future.iter().zip(log).map(|(a, b)| (a.position() - b.position()).norm()).sum();
        sum / future.len().max(1) as f64
    }

    /// Returns whether the lateral acceleration is within the grip.
    pub(super) fn has_grip(&self, future: &[AgentState]) -> bool {
        lateral_acceleration(&self.now(), future) <= GRIP_ACCELERATION
    }

    /// Returns whether all corners stay on the drivable area.
    pub(super) fn is_on_road(&self, future: &[AgentState]) -> bool {
        self.ground.depth(future, OFF_ROAD_TOLERANCE).is_none_or(|d| d <= OFF_ROAD_TOLERANCE)
    }

    pub(super) fn runs_red_light(&self, future: &[AgentState]) -> bool {
        self.signals.red_light_step(&self.now(), future).is_some()
    }
}

/// Another vehicle near the logged path, sampled at every fourth step.
pub(super) struct Neighbor {
    /// Half of its length, metres.
    pub(super) half_length: f64,
    positions: Vec<Option<PathPosition>>,
}

/// Position and speed of a vehicle relative to the logged path.
#[derive(Clone, Copy, Debug)]
pub(super) struct PathPosition {
    /// Distance along the path from the AV's current position, metres.
    pub(super) s: f64,
    /// Lateral distance from the path, metres, left positive.
    pub(super) offset: f64,
    /// Speed along the path, m/s.
    pub(super) speed: f64,
}

impl Neighbor {
    /// Number of steps between two samples.
    const SAMPLE_STEPS: usize = 4;

    /// Returns the position at a step, if the vehicle is present and near the path.
    pub(super) fn at(&self, step: usize) -> Option<PathPosition> {
        self.positions.get(step / Self::SAMPLE_STEPS).copied().flatten()
    }
}

/// Returns the vehicles that at some step are near the logged path: within about two lanes laterally,
/// and at most 60 m behind or beyond it.
fn neighbors(scenario: &Scenario, line: &Polyline) -> Vec<Neighbor> {
    // Largest lateral distance from the path, metres.
    const MAX_OFFSET: f64 = 8.0;
    // Largest distance behind or beyond the path, metres.
    const MAX_DISTANCE_BEYOND: f64 = 60.0;
    let agents = scenario.start.agents.iter().enumerate().skip(1);
    let vehicles = agents.filter(|(_, a)| a.kind == AgentKind::Vehicle);
    let length = scenario.length();
    let of = |(i, agent): (usize, &Agent)| {
        let path_position = |k: usize| {
            let frame = length.current() + Neighbor::SAMPLE_STEPS * k;
            let state = scenario.logged_at(i, frame)?;
            let velocity = scenario.logged_velocity(i, frame)?;
            let path_position = path_position(line, state.position(), velocity);
            let beyond = (-path_position.s).max(path_position.s - line.length());
            (path_position.offset.abs() < MAX_OFFSET && beyond < MAX_DISTANCE_BEYOND).then_some(path_position)
        };
        let positions: Vec<Option<PathPosition>> =
            (0..=length.future / Neighbor::SAMPLE_STEPS).map(path_position).collect();
        Neighbor { half_length: 0.5 * agent.length, positions }
    };
    vehicles.map(of).filter(|n| n.positions.iter().any(Option::is_some)).collect()
}

/// Returns the position relative to a line that is extended straight beyond its ends: a vehicle behind
/// the AV has a negative `s`.
fn path_position(line: &Polyline, p: Vec2, velocity: Vec2) -> PathPosition {
    let near = line.project(p);
    let along = direction(line.heading(near.segment));
    let (s, offset) = if near.s <= 0.0 || near.s >= line.length() {
        let from = p - line.at(near.s);
        (near.s + along.dot(&from), along.perp(&from))
    } else {
        (near.s, near.offset)
    };
    PathPosition { s, offset, speed: velocity.dot(&along) }
}

/// Returns the current curvature of the AV's path, 1/m, from the logged headings around it.
///
/// The time span is long enough for the AV to have moved a metre, but at most 2 s; 0 for an AV that
/// hardly moves.
fn curvature_now(scenario: &Scenario, drive: &LoggedDrive) -> f64 {
    let (history, current) = (&scenario.start.history[0], scenario.start.current());
    let longest = current.min(drive.states().len() - 1);
    for reach in [4, 7, 10].map(|reach| longest.min(reach)) {
        let (Some(before), after) = (history[current - reach], drive.states()[reach]) else { return 0.0 };
        let distance = (after.position() - before.position()).norm();
        if distance >= 1.0 {
            let sign = if drive.reverses() { -1.0 } else { 1.0 };
            return (sign * wrap(after.heading - before.heading) / distance).clamp(-0.25, 0.25);
        }
    }
    0.0
}

/// Returns the acceleration of the AV over the last half second, m/s²; 0 if it is unknown.
pub(super) fn acceleration_now(scenario: &Scenario) -> f64 {
    const WINDOW: usize = 5;
    let current = scenario.start.current();
    let window = WINDOW.min(current);
    let speed = |frame: usize| scenario.logged_velocity(0, frame).map(|v| v.norm());
    let (now, before) = (speed(current), speed(current - window));
    now.zip(before).map_or(0.0, |(a, b)| ((a - b) / (window as f64 * DT)).clamp(-4.0, 4.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn positions_behind_and_ahead_of_a_line_are_measured_along_it() {
        let line = Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(20.0, 0.0)]).unwrap();
        for (x, y) in [(-15.0, 3.5), (5.0, -1.0), (32.0, 2.0)] {
            let path_position = path_position(&line, Vec2::new(x, y), Vec2::new(7.0, 1.0));
            assert_eq!((path_position.s, path_position.offset, path_position.speed), (x, y, 7.0));
        }
    }
}
