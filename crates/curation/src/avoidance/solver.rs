//! The response of one agent on one path: a profile within the bounds, confirmed by exact distances.

use std::collections::BTreeSet;

use reactsim_geometry::OrientedBox;
use reactsim_scene::{AgentKind, AgentState, DT};

use super::Unavoidable;
use super::blocked::FootprintSamples;
use super::front::gap_to_front;
use super::own_path::OwnPath;
use super::problem::{Problem, YieldAssumption};
use super::profile::Profile;
use super::sides::{Side, SideChoice, combinations};
use super::smoothest::smoothest;
use super::speed_caps::SpeedCaps;
use super::traffic::{Boxes, PlannedResponse, distance, extent, is_nearer, reaction_step};
use crate::Response;

/// Largest number of rounds that add bounds for time gaps that a solution violates.
const MAX_GAP_ROUNDS: usize = 4;
/// Largest number of rounds that add bounds for speed caps that a solution violates.
const MAX_CAP_ROUNDS: usize = 5;
/// Extra acceleration, m/s², that sampling positions on chords of the path can introduce.
const CHORD_ACCELERATION: f64 = 0.15;
/// Largest distance by which a corner of a shifted vehicle may leave the drivable area, metres.
const OFF_ROAD_TOLERANCE: f64 = 0.3;
/// Addition to the time gap once a solution violates it, s: in a bend the gap shrinks more slowly than
/// the arc length grows, and an agent that creeps up to a stationary AV would violate it again and
/// again.
const EXTRA_TIME_GAP: f64 = 0.15;

impl Problem<'_> {
    /// Finds a response along a path.
    pub(super) fn along(
        &self,
        path: &OwnPath,
        assumption: YieldAssumption,
    ) -> Result<PlannedResponse, Unavoidable> {
        let reach = self.slowest.s.iter().copied().zip(self.fastest.s.iter().copied()).collect();
        let samples = FootprintSamples::new(path, reach);
        let (choices, followers) = self.choices(path, &samples, assumption)?;
        let cap = self.end_of_road(path).min(self.responder.furthest);
        let caps = {
            let (furthest, lateral) =
                (self.fastest.s[self.responder.steps], self.settings.max_lateral_acceleration);
            SpeedCaps::new(self.responder, self.kind(), path, furthest, lateral)
        };
        for sides in combinations(&choices) {
            if let Some(planned) = self.attempt(path, &caps, &choices, &followers, &sides, cap) {
                return Ok(planned);
            }
        }
        let mut between: Vec<String> = choices.iter().map(|c| self.name(c.region.by)).collect();
        between.dedup();
        Err(Unavoidable::HemmedIn { agent: self.id(self.responder.agent), between: between.join(", ") })
    }

    /// Returns the arc length at which a path leaves the road beyond the end of the log.
    fn end_of_road(&self, path: &OwnPath) -> f64 {
        let furthest = self.fastest.s[self.fastest.s.len() - 1];
        if self.kind() != AgentKind::Vehicle || furthest <= path.end {
            return f64::INFINITY;
        }
        let road = self.traffic.scenario.start.road_at(self.responder.agent);
        let mut near = None;
        let mut drivable = |s: f64| road.drivable(path.pose(s).0, &mut near) != Some(false);
        if !drivable(path.end) {
            return f64::INFINITY;
        }
        let count = (furthest - path.end).ceil() as usize;
        let off = (1..=count).map(|m| path.end + m as f64).find(|&s| !drivable(s));
        off.map_or(f64::INFINITY, |s| s - 1.0)
    }

    /// Finds a response that passes every region on the given side.
    fn attempt(
        &self,
        path: &OwnPath,
        caps: &SpeedCaps,
        choices: &[SideChoice],
        followers: &BTreeSet<usize>,
        sides: &[Side],
        cap: f64,
    ) -> Option<PlannedResponse> {
        let mut corridor = self.corridor(choices, sides, cap)?;
        let (mut gap_rounds, mut cap_rounds) = (0, 0);
        while gap_rounds < MAX_GAP_ROUNDS && cap_rounds < MAX_CAP_ROUNDS {
            let profile = smoothest(self.responder.motion, &self.responder.limits, &self.desired, &corridor)?;
            if !caps.allows(&profile) {
                caps.tighten(&profile, &mut corridor.speeds);
                cap_rounds += 1;
                continue;
            }
            let track = self.track(path, &profile);
            let broken = self.broken_gaps(&profile, &track);
            if broken.is_empty() {
                return self.verify(path, &profile, track, followers);
            }
            corridor.gaps.extend(broken);
            gap_rounds += 1;
        }
        None
    }

    /// Returns the states from step 0 on.
    fn track(&self, path: &OwnPath, profile: &Profile) -> Vec<AgentState> {
        let mut track = self.responder.before.clone();
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

    /// Returns bounds for all steps at which the AV is in front, if it is reached in less than the time
    /// gap at any of them; else none.
    fn broken_gaps(&self, profile: &Profile, track: &[AgentState]) -> Vec<(usize, f64, f64)> {
        let who = &self.traffic.scenario.start.agents[self.responder.agent];
        if who.kind != AgentKind::Vehicle {
            return Vec::new();
        }
        let (mut bounds, mut broken) = (Vec::new(), false);
        for k in 1..profile.s.len() {
            let step = self.responder.reaction + k;
            let front = gap_to_front(&track[step].footprint(who), &self.traffic.av_box(step), 0.0);
            let Some(gap) = front else { continue };
            let before = self.av_speed(step);
            let closing = track[step].speed() - before;
            broken |= closing > 0.0 && gap < self.settings.time_gap * closing;
            let time = self.settings.time_gap + (EXTRA_TIME_GAP * k as f64 / 10.0).min(EXTRA_TIME_GAP);
            bounds.push((k, time, profile.s[k] + gap + time * before));
        }
        if broken { bounds } else { Vec::new() }
    }

    /// Returns the response if exact distances confirm that it keeps clear.
    fn verify(
        &self,
        path: &OwnPath,
        profile: &Profile,
        track: Vec<AgentState>,
        followers: &BTreeSet<usize>,
    ) -> Option<PlannedResponse> {
        let who = &self.traffic.scenario.start.agents[self.responder.agent];
        let first = self.responder.reaction;
        if !self.is_drivable(&track) {
            return None;
        }
        let boxes = track.iter().enumerate().map(|(k, s)| {
            if k <= first { self.traffic.logged[self.responder.agent][k] } else { Some(s.footprint(who)) }
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
            for k in first + 1..boxes.len() {
                let (Some(me), Some(them)) = (&boxes[k], &theirs[k]) else { continue };
                if !other.pair.exempt(k) && is_nearer(me, them, other.pair.limit) {
                    return None;
                }
            }
        }
        if self.kind() == AgentKind::Vehicle && !self.is_on_road(path, profile, &boxes) {
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
        let (scenario, agent, steps) = (self.traffic.scenario, self.responder.agent, self.traffic.steps());
        let logged = |k: usize| scenario.logged_at(agent, scenario.start.current() + k);
        let seen = reaction_step(self.settings, steps, |k| response.track[k], logged);
        Some(PlannedResponse {
            response,
            boxes,
            extent: bounds,
            others_reaction_step: seen.map_or(steps, |k| k.min(steps)),
        })
    }

    /// Returns whether the states obey the limits of braking and acceleration: on the inside of a bend
    /// the distance driven differs from the arc length of the path, so that a shift that begins or ends
    /// in a bend may need more than the profile.
    fn is_drivable(&self, track: &[AgentState]) -> bool {
        let limits = &self.responder.limits;
        let mut before = self.responder.motion.speed;
        track[self.responder.reaction + 1..].iter().all(|state| {
            let gain = (state.speed() - before) / DT;
            before = state.speed();
            (limits.brake - CHORD_ACCELERATION..=limits.accelerate + CHORD_ACCELERATION).contains(&gain)
        })
    }

    /// Returns whether no corner leaves the drivable area, unless it does so on the logged path as well.
    /// Only states off that path, or beyond its end, are judged: the log itself is not.
    fn is_on_road(&self, path: &OwnPath, profile: &Profile, boxes: &Boxes) -> bool {
        let road = self.traffic.scenario.start.road_at(self.responder.agent);
        let mut near = [None; 4];
        let mut depth = |b: &OrientedBox| {
            let corners = b.corners().into_iter().zip(&mut near);
            corners.filter_map(|(c, near)| road.distance_off_road(c, near)).fold(0.0_f64, f64::max)
        };
        let plain = path.nudged(0.0, 1.0);
        let left = profile.s.iter().enumerate().skip(1).filter(|s| path.nudge != 0.0 || *s.1 > path.end);
        left.into_iter().all(|(k, &s)| {
            let off = boxes[self.responder.reaction + k].as_ref().map_or(0.0, &mut depth);
            off <= OFF_ROAD_TOLERANCE || off <= depth(&plain.footprint(s.min(path.end)))
        })
    }
}
