//! What all draws of one scenario share: the logged drive, what the others do, where else the AV could go.

use super::routes::{self, Branch, Meeting};
use crate::curation::ground::{Ground, lateral_acceleration};
use crate::curation::replay::LogReplay;
use crate::curation::signals::Signals;
use crate::dynamics::{AxlePath, follow_smoothly};
use crate::geometry::{Polyline, Vec2, direction, wrap};
use crate::rollout::{AvError, LoggedDrive};
use crate::scene::{Agent, AgentKind, AgentState, CURRENT, DT, FUTURE, Road, Scenario};

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
    /// Where and when others come onto the logged way under log replay.
    meetings: Vec<Meeting>,
    /// The logged motion of the other vehicles along the logged way.
    pub(super) neighbors: Vec<Neighbor>,
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
        let meetings = routes::meetings(scenario, &logged);
        Ok(Self {
            scenario,
            acceleration: acceleration_now(scenario),
            merge: routes::merge(scenario, &line),
            limits,
            replay: LogReplay::new(scenario),
            logged,
            meetings,
            neighbors: neighbors(scenario, &line),
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

    /// Whether an AV that stands has others passing beside it, into whose way it could pull out.
    pub(super) fn stands_aside(&self) -> bool {
        let passes = |n: &Neighbor| n.places.iter().flatten().any(|p| p.speed > 2.0 && p.offset.abs() > 1.5);
        !self.drive.reverses() && self.neighbors.iter().any(passes)
    }

    /// Where and when others come onto the logged way while the AV of the log is still before that place.
    pub(super) fn taken_first(&self) -> Vec<Meeting> {
        let states = self.drive.states();
        let before = |m: &Meeting| {
            let step = ((m.time / DT) as usize).min(FUTURE);
            self.line.project(states[step].position()).s + self.half_length() < m.s
        };
        self.meetings.iter().copied().filter(before).collect()
    }

    /// Half of the length of the AV, metres.
    pub(super) fn half_length(&self) -> f64 {
        0.5 * self.scenario.start.agents[0].length
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

    /// Whether a vehicle follows the AV of the log within two seconds, or 8 m, after so many seconds.
    pub(super) fn is_followed_closely(&self, after: f64) -> bool {
        let step = (after / DT) as usize / Neighbor::EVERY * Neighbor::EVERY;
        let own = self.line.project(self.drive.states()[step].position()).s;
        self.neighbors.iter().filter_map(|n| Some((n.half_length, n.at(step)?))).any(|(half_length, p)| {
            let gap = own - self.half_length() - p.s - half_length;
            p.offset.abs() < 1.5 && p.speed > 1.0 && gap > 0.0 && gap < (2.0 * p.speed).max(8.0)
        })
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
        self.signals.red_light_step(&self.now(), future).is_some()
    }
}

/// Another vehicle beside the logged way, at every fourth step.
pub(super) struct Neighbor {
    /// Half of its length, metres.
    pub(super) half_length: f64,
    places: Vec<Option<Place>>,
}

/// Where a vehicle is relative to the logged way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Place {
    /// Distance along the way from the AV's current position, metres.
    pub(super) s: f64,
    /// Distance beside the way, metres, left positive.
    pub(super) offset: f64,
    /// Speed along the way, m/s.
    pub(super) speed: f64,
}

impl Neighbor {
    /// Steps between two places.
    const EVERY: usize = 4;

    /// The place at a step, where the vehicle is there and beside the way.
    pub(super) fn at(&self, step: usize) -> Option<Place> {
        self.places.get(step / Self::EVERY).copied().flatten()
    }
}

/// The vehicles that drive beside the logged way (not farther than two lanes) at some step, or behind or ahead of it in the direction of
/// its end.
fn neighbors(scenario: &Scenario, line: &Polyline) -> Vec<Neighbor> {
    const FARTHEST: f64 = 8.0;
    const FARTHEST_ALONG: f64 = 60.0;
    let agents = scenario.start.agents.iter().enumerate().skip(1);
    let vehicles = agents.filter(|(_, a)| a.kind == AgentKind::Vehicle);
    let of = |(i, agent): (usize, &Agent)| {
        let place = |k: usize| {
            let state = scenario.logged_at(i, CURRENT + Neighbor::EVERY * k)?;
            let velocity = scenario.logged_velocity(i, CURRENT + Neighbor::EVERY * k)?;
            let place = place(line, state.position(), velocity);
            let beyond = (-place.s).max(place.s - line.length());
            (place.offset.abs() < FARTHEST && beyond < FARTHEST_ALONG).then_some(place)
        };
        let places: Vec<Option<Place>> = (0..=FUTURE / Neighbor::EVERY).map(place).collect();
        Neighbor { half_length: 0.5 * agent.length, places }
    };
    vehicles.map(of).filter(|n| n.places.iter().any(Option::is_some)).collect()
}

/// Where something is relative to a line that goes on straight beyond its ends: a vehicle behind the AV has a negative `s`.
fn place(line: &Polyline, p: Vec2, velocity: Vec2) -> Place {
    let near = line.project(p);
    let along = direction(line.heading(near.segment));
    let (s, offset) = if near.s <= 0.0 || near.s >= line.length() {
        let from = p - line.at(near.s);
        (near.s + along.dot(&from), along.perp(&from))
    } else {
        (near.s, near.offset)
    };
    Place { s, offset, speed: velocity.dot(&along) }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_behind_and_ahead_of_a_line_are_measured_along_it() {
        let line = Polyline::new(&[Vec2::new(0.0, 0.0), Vec2::new(10.0, 0.0), Vec2::new(20.0, 0.0)]).unwrap();
        for (x, y) in [(-15.0, 3.5), (5.0, -1.0), (32.0, 2.0)] {
            let place = place(&line, Vec2::new(x, y), Vec2::new(7.0, 1.0));
            assert_eq!((place.s, place.offset, place.speed), (x, y, 7.0));
        }
    }
}
