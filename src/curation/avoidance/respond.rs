//! The response of one agent: by speed along its own path, else with a sideways shift too.

use std::collections::BTreeSet;

use super::blocked::{Blob, Places};
use super::driver::Driver;
use super::front::gap_to_front;
use super::own_path::OwnPath;
use super::profile::{Corridor, Profile, extreme, smoothest};
use super::traffic::{Planned, Traffic, distance, extent, nearer};
use super::{AvoidanceSettings, Unavoidable};
use crate::curation::Response;
use crate::scene::{AgentKind, AgentState, DT, FUTURE};

/// Combinations of sides that are tried on one path.
const MOST_COMBINATIONS: usize = 6;
/// Rounds of adding what a solution was found to break.
const MOST_ROUNDS: usize = 4;
/// What blocked stretches are larger than what is asked for, metres.
const MARGIN: f64 = 0.01;
/// Pairs that come nearer than this in the log are not kept apart by it, metres.
const TOUCHING: f64 = 0.03;
/// Cosine of the heading difference up to which somebody behind is a follower (45 degrees).
const FOLLOWER_COS: f64 = 0.7;
/// The largest second derivative of the smooth step from 0 to 1.
const SMOOTH_STEP_BEND: f64 = 5.78;
/// Share of the lateral acceleration that is left to a shift, on a path that bends.
const SHIFT_SHARE: f64 = 0.6;
/// Curvature that a shift may add to that of the path, 1/m.
const SHIFT_CURVATURE: f64 = 0.15;

/// Which side of a blob an agent passes on.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Side {
    Behind,
    Ahead,
}

/// A blob with what is possible there.
struct Choice {
    blob: Blob,
    gaps: Vec<(usize, f64, f64)>,
    preferred: Side,
    behind: bool,
    ahead: bool,
}

/// Who else is expected to respond where this agent does.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Courtesy {
    /// Those who come from behind.
    OfFollowers,
    /// Those too who cross the path of this agent after it in the log.
    OfAllWhoComeLater,
}

/// Finds a response of an agent against everybody as they move now: by speed, else with a shift; and where neither is found, the same
/// again with more courtesy of others.
pub(super) fn respond(
    traffic: &Traffic<'_>,
    agent: usize,
    reaction: usize,
    settings: &AvoidanceSettings,
) -> Result<Planned, Unavoidable> {
    let who = &traffic.scenario.start.agents[agent];
    let Some(driver) = Driver::new(traffic, agent, reaction, settings) else {
        return Err(Unavoidable::Absent { agent: who.id.clone() });
    };
    let solver = Solver::new(traffic, &driver, settings);
    let mut why = None;
    for courtesy in [Courtesy::OfFollowers, Courtesy::OfAllWhoComeLater] {
        match solver.along(&driver.path, courtesy) {
            Ok(planned) => return Ok(planned),
            Err(reason) if why.is_none() => why = Some(reason),
            Err(_) => {}
        }
        for path in nudged(&driver, who.kind, settings) {
            if let Ok(planned) = solver.along(&path, courtesy) {
                return Ok(planned);
            }
        }
    }
    Err(why.unwrap_or(Unavoidable::Absent { agent: who.id.clone() }))
}

/// The paths of a vehicle with a shift to either side, the small ones first.
fn nudged(driver: &Driver, kind: AgentKind, settings: &AvoidanceSettings) -> Vec<OwnPath> {
    if kind != AgentKind::Vehicle || !(settings.max_nudge > 0.0) {
        return Vec::new();
    }
    let along = |share: f64| {
        let nudge = share * settings.max_nudge;
        let grip = SHIFT_SHARE * settings.max_lateral_acceleration;
        let by_grip = driver.motion.speed * (SMOOTH_STEP_BEND * nudge.abs() / grip).sqrt();
        let by_steering = (SMOOTH_STEP_BEND * nudge.abs() / SHIFT_CURVATURE).sqrt();
        driver.path.nudged(nudge, by_grip.max(by_steering))
    };
    [0.5, -0.5, 1.0, -1.0].map(along).to_vec()
}

/// What is added to the time gap where a solution was found to break it, seconds: on a bend the gap shrinks more slowly than the arc
/// length grows, and who creeps up to a standing AV would break it again and again.
const SPARE_TIME: f64 = 0.15;

/// Whom an agent must keep clear of, and by how much.
struct Other {
    slot: usize,
    clearance: f64,
}

struct Solver<'t> {
    traffic: &'t Traffic<'t>,
    driver: &'t Driver,
    settings: &'t AvoidanceSettings,
    /// Distance to the AV that is kept, metres.
    to_av: f64,
    slowest: Profile,
    fastest: Profile,
    wanted: Vec<f64>,
    others: Vec<Other>,
}

impl<'t> Solver<'t> {
    fn new(traffic: &'t Traffic<'t>, driver: &'t Driver, settings: &'t AvoidanceSettings) -> Self {
        let steps = driver.steps();
        let slowest = extreme(driver.motion, &driver.limits, steps, true);
        let fastest = extreme(driver.motion, &driver.limits, steps, false);
        // Who is nearer to the AV than that already need not leave.
        let now = distance(&driver.path.footprint(0.0), &traffic.av_box(driver.reaction));
        let to_av = settings.clearance.min(now - 2.0 * MARGIN).max(0.0);
        let kinds = |i: usize| traffic.scenario.start.agents[i].kind;
        let light = |k: AgentKind| matches!(k, AgentKind::Pedestrian | AgentKind::Cyclist);
        // Pairs that the metric does not judge.
        let judged = |i: usize| {
            let (a, b) = (kinds(driver.agent), kinds(i));
            !(light(a) && light(b) && (a, b) != (AgentKind::Cyclist, AgentKind::Cyclist))
        };
        let other = |i: usize| {
            let apart = traffic.log_distance(driver.agent, i);
            let clearance = settings.clearance_to_others.min(apart - TOUCHING);
            (clearance >= 0.0).then_some(Other { slot: i, clearance })
        };
        let others =
            (1..traffic.len()).filter(|&i| i != driver.agent && judged(i)).filter_map(other).collect();
        Self { traffic, driver, settings, to_av, slowest, fastest, wanted: driver.wanted(), others }
    }

    fn along(&self, path: &OwnPath, courtesy: Courtesy) -> Result<Planned, Unavoidable> {
        let reach = self.slowest.s.iter().copied().zip(self.fastest.s.iter().copied()).collect();
        let places = Places::new(path, reach);
        let (choices, followers) = self.choices(path, &places, courtesy)?;
        let cap = self.end_of_road(path);
        for sides in combinations(&choices) {
            if let Some(planned) = self.attempt(path, &choices, &followers, &sides, cap) {
                return Ok(planned);
            }
        }
        let mut between: Vec<String> = choices.iter().map(|c| self.name(c.blob.by)).collect();
        between.dedup();
        Err(Unavoidable::HemmedIn { agent: self.id(self.driver.agent), between: between.join(", ") })
    }

    /// How messages call an agent.
    fn name(&self, slot: usize) -> String {
        if slot == 0 { "the AV".to_owned() } else { format!("agent `{}`", self.id(slot)) }
    }

    fn id(&self, slot: usize) -> String {
        self.traffic.scenario.start.agents[slot].id.clone()
    }

    /// What blocks the path, with the sides that can be reached; and who only runs into this agent from behind: these answer for
    /// themselves.
    fn choices(
        &self,
        path: &OwnPath,
        places: &Places<'_>,
        courtesy: Courtesy,
    ) -> Result<(Vec<Choice>, BTreeSet<usize>), Unavoidable> {
        let first = self.driver.reaction;
        let (boxes, extent) = self.traffic.boxes(0);
        let (mut choices, mut followers) = (Vec::new(), BTreeSet::new());
        for blob in places.blobs(0, boxes, extent, first, self.to_av + MARGIN) {
            choices.push(self.choice(path, blob)?);
        }
        for other in &self.others {
            let (boxes, extent) = self.traffic.boxes(other.slot);
            for mut blob in places.blobs(other.slot, boxes, extent, first, other.clearance) {
                let all = blob.stretches.len();
                let later = courtesy == Courtesy::OfAllWhoComeLater && self.comes_later(&blob);
                blob.stretches.retain(|s| !later && !self.followed_by(other.slot, first + s.step));
                if blob.stretches.len() < all {
                    followers.insert(other.slot);
                }
                if !blob.stretches.is_empty() {
                    choices.push(self.choice(path, blob)?);
                }
            }
        }
        Ok((choices, followers))
    }

    /// Whether the agent is past a blob in its log when that begins.
    fn comes_later(&self, blob: &Blob) -> bool {
        blob.stretches.first().is_some_and(|s| self.driver.logged[s.step] > s.from)
    }

    /// Whether somebody comes from behind in the log: it must not run into this agent, whatever that does.
    fn followed_by(&self, other: usize, step: usize) -> bool {
        let logged = &self.traffic.logged;
        let (Some(me), Some(them)) = (&logged[self.driver.agent][step], &logged[other][step]) else {
            return false;
        };
        me.to_local(them.center).x < 0.0 && me.axis.dot(&them.axis) > FOLLOWER_COS
    }

    fn choice(&self, path: &OwnPath, blob: Blob) -> Result<Choice, Unavoidable> {
        let gaps = if blob.by == 0 { self.gaps(path, &blob) } else { Vec::new() };
        let late = blob.stretches.iter().find(|s| s.from < self.slowest.s[s.step]).map(|s| s.step);
        let close = gaps
            .iter()
            .find(|(step, gap, bound)| self.slowest.s[*step] + gap * self.slowest.v[*step] > *bound);
        let late = late.or(close.map(|g| g.0));
        let ahead = blob.stretches.iter().all(|s| s.to <= self.fastest.s[s.step]);
        if let (Some(step), false) = (late, ahead) {
            return Err(Unavoidable::TooClose {
                agent: self.id(self.driver.agent),
                other: self.name(blob.by),
                step: self.driver.reaction + step,
            });
        }
        let preferred = if blob.by != 0 && self.comes_later(&blob) { Side::Ahead } else { Side::Behind };
        Ok(Choice { blob, gaps, preferred, behind: late.is_none(), ahead })
    }

    /// The time to collision with the AV as bounds, where the agent waits behind it.
    fn gaps(&self, path: &OwnPath, blob: &Blob) -> Vec<(usize, f64, f64)> {
        let of = |s: &super::blocked::Stretch| {
            let step = self.driver.reaction + s.step;
            let gap = gap_to_front(&path.footprint(s.from.max(0.0)), &self.traffic.av_box(step), 0.1)?;
            Some((
                s.step,
                self.settings.time_gap,
                s.from.max(0.0) + gap + self.settings.time_gap * self.av_speed(step),
            ))
        };
        blob.stretches.iter().filter(|s| s.from.is_finite()).filter_map(of).collect()
    }

    fn av_speed(&self, step: usize) -> f64 {
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
        let vehicle = self.traffic.scenario.start.agents[self.driver.agent].kind == AgentKind::Vehicle;
        if !vehicle || furthest <= path.end {
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
        choices: &[Choice],
        followers: &BTreeSet<usize>,
        sides: &[Side],
        cap: f64,
    ) -> Option<Planned> {
        let mut corridor = self.corridor(choices, sides, cap)?;
        for _ in 0..MOST_ROUNDS {
            let profile = smoothest(self.driver.motion, &self.driver.limits, &self.wanted, &corridor)?;
            let track = self.track(path, &profile);
            let broken = self.broken_gaps(&profile, &track);
            if broken.is_empty() {
                return self.verified(path, &profile, track, followers);
            }
            corridor.gaps.extend(broken);
        }
        None
    }

    fn corridor(&self, choices: &[Choice], sides: &[Side], cap: f64) -> Option<Corridor> {
        let steps = self.driver.steps();
        let (mut lower, mut upper) = (vec![f64::NEG_INFINITY; steps + 1], vec![f64::INFINITY; steps + 1]);
        let mut gaps = Vec::new();
        if cap.is_finite() {
            // Who can not stop on the road need not.
            let stop = self.slowest.s[steps] + 0.5;
            upper.fill(cap.max(stop));
        }
        for (choice, side) in choices.iter().zip(sides) {
            for s in &choice.blob.stretches {
                match side {
                    Side::Behind => upper[s.step] = upper[s.step].min(s.from),
                    Side::Ahead => lower[s.step] = lower[s.step].max(s.to),
                }
            }
            if *side == Side::Behind {
                gaps.extend(choice.gaps.iter().copied());
            }
        }
        // Nobody goes back.
        for k in (0..steps).rev() {
            upper[k] = upper[k].min(upper[k + 1]);
        }
        for k in 1..=steps {
            lower[k] = lower[k].max(lower[k - 1]);
        }
        let possible =
            |k: usize| lower[k] <= upper[k] && self.slowest.s[k] <= upper[k] && lower[k] <= self.fastest.s[k];
        (1..=steps).all(possible).then_some(Corridor { lower, upper, gaps })
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
        let boxes = track.iter().enumerate().map(|(k, s)| {
            if k <= first { self.traffic.logged[self.driver.agent][k] } else { Some(s.footprint(who)) }
        });
        let boxes: Vec<_> = boxes.collect();
        let mut clearance = f64::INFINITY;
        for k in 1..=FUTURE {
            let Some(me) = &boxes[k] else { continue };
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
                if nearer(me, them, 0.0) {
                    return None;
                }
            }
        }
        if path.nudge != 0.0 && !self.on_road(&track) {
            return None;
        }
        let peak = profile.v.windows(2).fold(0.0_f64, |a, w| a.max((w[0] - w[1]) / DT));
        let response = Response {
            agent: who.id.clone(),
            reaction_step: first,
            nudge: path.nudge,
            peak_deceleration: peak,
            clearance,
            track,
        };
        Some(Planned { response, boxes, extent: bounds })
    }

    /// Whether the centre never leaves the road, unless it is off the road already.
    fn on_road(&self, track: &[AgentState]) -> bool {
        let road = self.traffic.scenario.start.road();
        let mut near = None;
        let mut off = |s: &AgentState| road.drivable(s.position(), &mut near) == Some(false);
        let first = self.driver.reaction;
        off(&track[first]) || !track[first + 1..].iter().any(off)
    }
}

/// Sides for all blobs: those preferred, then with one changed, then with two.
fn combinations(choices: &[Choice]) -> Vec<Vec<Side>> {
    let usual: Vec<Side> = choices
        .iter()
        .map(|c| match (c.behind, c.ahead) {
            (true, false) => Side::Behind,
            (false, _) => Side::Ahead,
            _ => c.preferred,
        })
        .collect();
    let free: Vec<usize> = (0..choices.len()).filter(|&i| choices[i].behind && choices[i].ahead).collect();
    let changed = |which: &[usize]| {
        let mut sides = usual.clone();
        for &i in which {
            sides[i] = if sides[i] == Side::Behind { Side::Ahead } else { Side::Behind };
        }
        sides
    };
    let mut all = vec![usual.clone()];
    all.extend(free.iter().map(|&i| changed(&[i])));
    for (n, &i) in free.iter().enumerate() {
        all.extend(free[n + 1..].iter().map(|&j| changed(&[i, j])));
    }
    all.truncate(MOST_COMBINATIONS);
    all
}
