//! One agent against everybody else on one path: a profile between the bounds, and whether exact distances confirm it.

use std::collections::BTreeSet;

use super::blocked::Places;
use super::driver::Driver;
use super::front::gap_to_front;
use super::own_path::OwnPath;
use super::pace::Pace;
use super::profile::{Profile, extreme};
use super::respond::Courtesy;
use super::sides::{Choice, Side, combinations};
use super::smoothest::smoothest;
use super::traffic::{Boxes, Pair, Planned, Traffic, distance, extent, nearer, reaction_step};
use super::{AvoidanceSettings, Unavoidable};
use crate::curation::Response;
use crate::geometry::OrientedBox;
use crate::metrics::pair_counts;
use crate::scene::{AgentKind, AgentState, CURRENT, DT, FUTURE};

/// Rounds of adding what a solution was found to break: time gaps ...
const MOST_ROUNDS: usize = 4;
/// ... and speeds on bends.
const MOST_PACE_ROUNDS: usize = 5;
/// What positions on the chords of a path may add to the acceleration of the profile, m/s².
const CHORDS: f64 = 0.15;
/// How far a corner of a shifted vehicle may leave the drivable ground, metres.
const OFF_ROAD: f64 = 0.3;
/// What blocked stretches are larger than what is asked for, metres.
pub(super) const MARGIN: f64 = 0.01;
/// How much nearer to each other than in the log two may come where the log brings them close, metres.
const TOUCHING: f64 = 0.03;
/// Way on which a halt is not asked to be the hardest one, metres.
pub(super) const STOPS: f64 = 0.5;
/// What is added to the time gap where a solution was found to break it, seconds: on a bend the gap shrinks more slowly than the arc
/// length grows, and who creeps up to a standing AV would break it again and again.
const SPARE_TIME: f64 = 0.15;

/// Whom an agent must keep clear of, and by how much.
pub(super) struct Other {
    pub(super) slot: usize,
    pub(super) clearance: f64,
    pub(super) pair: Pair,
}

/// The question of one agent: what it brings along, and whom it must keep clear of.
pub(super) struct Solver<'t> {
    pub(super) traffic: &'t Traffic<'t>,
    pub(super) driver: &'t Driver,
    pub(super) settings: &'t AvoidanceSettings,
    /// Distance to the AV that is kept, metres.
    pub(super) to_av: f64,
    pub(super) slowest: Profile,
    pub(super) fastest: Profile,
    pub(super) wanted: Vec<f64>,
    pub(super) others: Vec<Other>,
}

impl<'t> Solver<'t> {
    pub(super) fn new(traffic: &'t Traffic<'t>, driver: &'t Driver, settings: &'t AvoidanceSettings) -> Self {
        let steps = driver.steps();
        let slowest = extreme(driver.motion, &driver.limits, steps, true);
        let mut fastest = extreme(driver.motion, &driver.limits, steps, false);
        // Who can not stop before that goes on to where it can.
        let furthest = driver.furthest.max(slowest.s[steps] + STOPS);
        fastest.s.iter_mut().for_each(|s| *s = s.min(furthest));
        // Who is nearer to the AV than that already need not leave.
        let now = distance(&driver.path.footprint(0.0), &traffic.av_box(driver.reaction));
        let to_av = settings.clearance.min(now - 2.0 * MARGIN).max(0.0);
        let kinds = |i: usize| traffic.scenario.start.agents.get(i).map_or(AgentKind::Other, |a| a.kind);
        // Pairs that the metric does not judge are not kept apart.
        let judged = |i: usize| pair_counts(kinds(driver.agent), kinds(i));
        let other = |i: usize| {
            let pair = traffic.pair(driver.agent, i);
            Other { slot: i, clearance: settings.clearance_to_others.min(pair.closest - TOUCHING), pair }
        };
        let others = (1..traffic.bodies()).filter(|&i| i != driver.agent && judged(i)).map(other).collect();
        Self { traffic, driver, settings, to_av, slowest, fastest, wanted: driver.wanted(), others }
    }

    /// A response along a path.
    pub(super) fn along(&self, path: &OwnPath, courtesy: Courtesy) -> Result<Planned, Unavoidable> {
        let reach = self.slowest.s.iter().copied().zip(self.fastest.s.iter().copied()).collect();
        let places = Places::new(path, reach);
        let (choices, followers) = self.choices(path, &places, courtesy)?;
        let cap = self.end_of_road(path).min(self.driver.furthest);
        let pace = {
            let (furthest, lateral) =
                (self.fastest.s[self.driver.steps()], self.settings.max_lateral_acceleration);
            Pace::new(self.driver, self.kind(), path, furthest, lateral)
        };
        for sides in combinations(&choices) {
            if let Some(planned) = self.attempt(path, &pace, &choices, &followers, &sides, cap) {
                return Ok(planned);
            }
        }
        let mut between: Vec<String> = choices.iter().map(|c| self.name(c.blob.by)).collect();
        between.dedup();
        Err(Unavoidable::HemmedIn { agent: self.id(self.driver.agent), between: between.join(", ") })
    }

    /// How messages call an agent.
    pub(super) fn name(&self, slot: usize) -> String {
        match slot {
            0 => "the AV".to_owned(),
            _ if slot >= self.traffic.len() => "an obstacle".to_owned(),
            _ => format!("agent `{}`", self.id(slot)),
        }
    }

    fn kind(&self) -> AgentKind {
        self.traffic.scenario.start.agents[self.driver.agent].kind
    }

    pub(super) fn id(&self, slot: usize) -> String {
        self.traffic.scenario.start.agents[slot].id.clone()
    }

    /// Speed of the AV at a step, m/s.
    pub(super) fn av_speed(&self, step: usize) -> f64 {
        let v = self.traffic.av[step].speed();
        if v.is_nan() && step > 0 {
            (self.traffic.av[step].position() - self.traffic.av[step - 1].position()).norm() / DT
        } else {
            v
        }
    }

    /// Where a path leaves the road beyond the end of the log.
    fn end_of_road(&self, path: &OwnPath) -> f64 {
        let furthest = self.fastest.s[self.fastest.s.len() - 1];
        if self.kind() != AgentKind::Vehicle || furthest <= path.end {
            return f64::INFINITY;
        }
        let road = self.traffic.scenario.start.road();
        let mut near = None;
        let mut drivable = |s: f64| road.drivable(path.pose(s).0, &mut near) != Some(false);
        if !drivable(path.end) {
            return f64::INFINITY;
        }
        let count = (furthest - path.end).ceil() as usize;
        let off = (1..=count).map(|m| path.end + m as f64).find(|&s| !drivable(s));
        off.map_or(f64::INFINITY, |s| s - 1.0)
    }

    /// A response that passes every blob on its side.
    fn attempt(
        &self,
        path: &OwnPath,
        pace: &Pace,
        choices: &[Choice],
        followers: &BTreeSet<usize>,
        sides: &[Side],
        cap: f64,
    ) -> Option<Planned> {
        let mut corridor = self.corridor(choices, sides, cap)?;
        let (mut rounds, mut pace_rounds) = (0, 0);
        while rounds < MOST_ROUNDS && pace_rounds < MOST_PACE_ROUNDS {
            let profile = smoothest(self.driver.motion, &self.driver.limits, &self.wanted, &corridor)?;
            if !pace.keeps(&profile) {
                pace.tighten(&profile, &mut corridor.speeds);
                pace_rounds += 1;
                continue;
            }
            let track = self.track(path, &profile);
            let broken = self.broken_gaps(&profile, &track);
            if broken.is_empty() {
                return self.verified(path, &profile, track, followers);
            }
            corridor.gaps.extend(broken);
            rounds += 1;
        }
        None
    }

    /// The states at the steps 0 to 80.
    fn track(&self, path: &OwnPath, profile: &Profile) -> Vec<AgentState> {
        let mut track = self.driver.before.clone();
        for w in profile.s.windows(2) {
            let last = track[track.len() - 1];
            let next = if w[1] == w[0] {
                AgentState { vx: 0.0, vy: 0.0, ..last }
            } else {
                let (position, heading) = path.pose(w[1]);
                let v = (position - last.position()) / DT;
                AgentState { x: position.x, y: position.y, heading, vx: v.x, vy: v.y }
            };
            track.push(next);
        }
        track
    }

    /// Where the AV in front is reached in less than the time gap: bounds for all steps at which it is in front.
    fn broken_gaps(&self, profile: &Profile, track: &[AgentState]) -> Vec<(usize, f64, f64)> {
        let who = &self.traffic.scenario.start.agents[self.driver.agent];
        if who.kind != AgentKind::Vehicle {
            return Vec::new();
        }
        let (mut bounds, mut broken) = (Vec::new(), false);
        for k in 1..profile.s.len() {
            let step = self.driver.reaction + k;
            let front = gap_to_front(&track[step].footprint(who), &self.traffic.av_box(step), 0.0);
            let Some(gap) = front else { continue };
            let before = self.av_speed(step);
            let closing = track[step].speed() - before;
            broken |= closing > 0.0 && gap < self.settings.time_gap * closing;
            let time = self.settings.time_gap + (SPARE_TIME * k as f64 / 10.0).min(SPARE_TIME);
            bounds.push((k, time, profile.s[k] + gap + time * before));
        }
        if broken { bounds } else { Vec::new() }
    }

    /// The response, where exact distances say that it keeps clear.
    fn verified(
        &self,
        path: &OwnPath,
        profile: &Profile,
        track: Vec<AgentState>,
        followers: &BTreeSet<usize>,
    ) -> Option<Planned> {
        let who = &self.traffic.scenario.start.agents[self.driver.agent];
        let first = self.driver.reaction;
        if !self.drivable(&track) {
            return None;
        }
        let boxes = track.iter().enumerate().map(|(k, s)| {
            if k <= first { self.traffic.logged[self.driver.agent][k] } else { Some(s.footprint(who)) }
        });
        let boxes: Vec<_> = boxes.collect();
        let mut clearance = f64::INFINITY;
        for (k, me) in boxes.iter().enumerate().skip(1) {
            let Some(me) = me else { continue };
            let apart = distance(me, &self.traffic.av_box(k));
            clearance = clearance.min(apart);
            if k > first && apart < self.to_av {
                return None;
            }
        }
        let bounds = extent(&boxes);
        for other in self.others.iter().filter(|o| !followers.contains(&o.slot)) {
            let (theirs, extent) = self.traffic.boxes(other.slot);
            if !bounds.intersects(extent) {
                continue;
            }
            for k in first + 1..=FUTURE {
                let (Some(me), Some(them)) = (&boxes[k], &theirs[k]) else { continue };
                if !other.pair.exempt(k) && nearer(me, them, other.pair.limit) {
                    return None;
                }
            }
        }
        if self.kind() == AgentKind::Vehicle && !self.on_road(path, profile, &boxes) {
            return None;
        }
        let peak = profile.v.windows(2).fold(0.0_f64, |a, w| a.max((w[0] - w[1]) / DT));
        let response = Response {
            agent: who.id.clone(),
            leader: None,
            reaction_step: first,
            nudge: path.nudge,
            peak_deceleration: peak,
            clearance,
            effort: None,
            track,
        };
        let (scenario, agent) = (self.traffic.scenario, self.driver.agent);
        let seen =
            reaction_step(self.settings, |k| response.track[k], |k| scenario.logged_at(agent, CURRENT + k));
        Some(Planned { response, boxes, extent: bounds, seen: seen.map_or(FUTURE, |k| k.min(FUTURE)) })
    }

    /// Whether the states keep the limits of braking and acceleration: on the inside of a bend less way is driven than along the path,
    /// so that a shift that begins or ends in a bend may ask for more than the profile.
    fn drivable(&self, track: &[AgentState]) -> bool {
        let limits = &self.driver.limits;
        let mut before = self.driver.motion.speed;
        track[self.driver.reaction + 1..].iter().all(|state| {
            let gain = (state.speed() - before) / DT;
            before = state.speed();
            (limits.brake - CHORDS..=limits.accelerate + CHORDS).contains(&gain)
        })
    }

    /// Whether no corner leaves the drivable ground, unless it is off the ground on the logged path as well. Only where the agent is
    /// beside that path, or beyond its end: what the log does is not judged.
    fn on_road(&self, path: &OwnPath, profile: &Profile, boxes: &Boxes) -> bool {
        let road = self.traffic.scenario.start.road();
        let mut near = [None; 4];
        let mut depth = |b: &OrientedBox| {
            let corners = b.corners().into_iter().zip(&mut near);
            corners.filter_map(|(c, near)| road.off_road_by(c, near)).fold(0.0_f64, f64::max)
        };
        let plain = path.plain();
        let left = profile.s.iter().enumerate().skip(1).filter(|s| path.nudge != 0.0 || *s.1 > path.end);
        left.into_iter().all(|(k, &s)| {
            let off = boxes[self.driver.reaction + k].as_ref().map_or(0.0, &mut depth);
            off <= OFF_ROAD || off <= depth(&plain.footprint(s.min(path.end)))
        })
    }
}
