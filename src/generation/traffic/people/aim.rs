//! Where people want to go next, and how fast.

use super::walker::{Activity, Walker};
use super::{Crowd, Surroundings, WalkLight};
use crate::geometry::Vec2;

/// How far ahead people look for their way, metres.
pub(super) const LOOK: f64 = 1.4;
/// A crossing nearer than this is thought of, metres.
const THINK: f64 = 6.0;
/// Who waits stands so far behind the kerb, metres: no box is over the road.
const BEHIND_KERB: f64 = 0.6;
/// Nobody who waits comes nearer to the kerb than this, metres.
const AT_KERB: f64 = 0.45;
/// Braking at kerbs and before vehicles, m/s².
const BRAKE: f64 = 0.9;
const BRAKE_HARD: f64 = 1.8;
/// People walk faster on roads than beside them (chosen), and faster still when their time runs out.
const BRISK: f64 = 1.06;
const HURRY: f64 = 1.3;
/// Time that people leave after a vehicle, before one, and need to start from standing, seconds.
const AFTER: f64 = 0.5;
const BEFORE: f64 = 1.0;
const START_UP: f64 = 0.5;
/// Braking that somebody on the road still expects of who comes, m/s².
const EXPECTED: f64 = 4.0;

/// What somebody wants to do in this step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    /// Unit vector.
    pub(super) towards: Vec2,
    /// m/s; 0 for who stands.
    pub(super) speed: f64,
    /// The crossing that it is at, if any.
    pub(super) crossing: Option<usize>,
    /// Whether stepping off looks possible.
    pub(super) clear: bool,
    /// The kerb that it may not pass now: a point, and the unit vector onto the road.
    pub(super) bar: Option<(Vec2, Vec2)>,
}

impl Aim {
    /// Keeps who waits off the road, however others push: back to the kerb, or to where it was if that is nearer to the road.
    pub(super) fn held_back(&self, p: Vec2, from: Vec2) -> Vec2 {
        let Some((kerb, onto)) = self.bar else { return p };
        let over = |q: Vec2| (q - kerb).dot(&onto) + AT_KERB;
        p - onto * (over(p) - over(from).max(0.0)).max(0.0)
    }
}

/// Where somebody is with regard to a crossing ahead or underfoot.
#[derive(Clone, Copy, Debug)]
pub(super) struct AtCrossing {
    pub(super) which: usize,
    /// Whether it is walked along its line.
    pub(super) forward: bool,
    /// Arc length on its line, metres; before its beginning as if it went on straight.
    pub(super) s: f64,
    /// To the kerb at which the road begins, metres; negative on the road.
    pub(super) to_kerb: f64,
    /// To the kerb at which it ends, metres.
    pub(super) to_end: f64,
}

impl Crowd {
    /// What lies ahead of the current stretch: the stretch, and whether it is walked along its line.
    pub(super) fn onward(&self, w: &Walker) -> Option<(usize, bool)> {
        let node = self.network.stretches[w.stretch].ends[usize::from(w.forward)];
        let next = self.network.next(w.goal, node)?;
        Some((next, self.network.stretches[next].ends[0] == node))
    }

    /// What is left of the current stretch, metres.
    pub(super) fn remaining(&self, w: &Walker) -> f64 {
        if w.forward { self.network.stretches[w.stretch].line.length() - w.s } else { w.s }
    }

    /// The crossing that somebody is on, or comes to.
    pub(super) fn at_crossing(&self, w: &Walker) -> Option<AtCrossing> {
        let place = |which: usize, forward: bool, s: f64| {
            let [a, b] = self.crossings[which].kerbs;
            let (to_kerb, to_end) = if forward { (a - s, b - s) } else { (s - b, s - a) };
            AtCrossing { which, forward, s, to_kerb, to_end }
        };
        if let Some(which) = self.network.stretches[w.stretch].crossing {
            let length = self.network.stretches[w.stretch].line.length();
            let begun = if w.forward { w.s > 0.0 } else { w.s < length };
            let s = if begun { w.s } else { self.straight_on(w, w.stretch, w.forward) };
            let here = place(which, w.forward, s);
            if here.to_end > 0.0 {
                return Some(here);
            }
        }
        let remaining = self.remaining(w);
        if remaining > THINK {
            return None;
        }
        let (next, forward) = self.onward(w)?;
        let which = self.network.stretches[next].crossing?;
        Some(place(which, forward, self.straight_on(w, next, forward)))
    }

    /// Arc length on a stretch for somebody who is not on it yet, as the crow flies (corners are cut) and as if it went on straight.
    fn straight_on(&self, w: &Walker, stretch: usize, forward: bool) -> f64 {
        let on = &self.network.stretches[stretch];
        let (begin, segment) = if forward { (0.0, 0) } else { (on.line.length(), on.line.segments() - 1) };
        let from = w.position - self.end(stretch, !forward);
        let ahead = from.dot(&on.along(segment));
        let aside = (from.perp(&on.along(segment)).abs() - on.half).max(0.0);
        begin + ahead + if forward { -aside } else { aside }
    }

    /// An end of a stretch: the last point of its line, or the first.
    pub(super) fn end(&self, stretch: usize, last: bool) -> Vec2 {
        let points = self.network.stretches[stretch].line.points();
        if last { points[points.len() - 1] } else { points[0] }
    }

    /// Where to, and how fast.
    pub(super) fn aim(&self, w: &Walker, surroundings: &Surroundings<'_>) -> Aim {
        let mut aim = Aim { towards: w.facing, speed: 0.0, crossing: None, clear: false, bar: None };
        if matches!(w.activity, Activity::Standing(_)) {
            return aim;
        }
        aim.speed = w.pace();
        let mut look = LOOK;
        if let Some(place) = self.at_crossing(w) {
            aim.crossing = Some(place.which);
            let light = self.light(place.which, surroundings);
            if place.to_kerb > 0.0 {
                aim.clear = place.to_kerb < 2.0 * w.desired_speed + 1.0
                    && self.lasts(w, &place, light)
                    && self.let_go(w, &place, surroundings);
                if !(aim.clear && w.looked >= w.reaction) {
                    let way = place.to_kerb - BEHIND_KERB;
                    aim.speed = aim.speed.min((2.0 * BRAKE * way.max(0.0)).sqrt());
                    if way < 0.12 || (way < 2.0 && self.queues(w)) {
                        aim.speed = 0.0;
                    }
                    look = look.min(way.max(0.3));
                    aim.bar = Some(self.kerb(&place));
                }
            } else {
                let late = place.to_end > aim.speed * light.seconds_left;
                aim.speed *= if late { HURRY } else { BRISK };
                aim.speed = aim.speed.min(self.before_vehicles(&place, aim.speed, surroundings));
            }
        }
        if w.rank > 0 {
            aim.speed = self.together(w, aim.speed);
        }
        let towards = self.target(w, look) - w.position;
        let distance = towards.norm();
        if distance > 1e-6 {
            aim.towards = w.detoured(towards / distance);
        }
        aim
    }

    /// The kerb before somebody, and the way onto the road.
    fn kerb(&self, place: &AtCrossing) -> (Vec2, Vec2) {
        let stretch = &self.network.stretches[self.at[place.which]];
        let sign = if place.forward { 1.0 } else { -1.0 };
        let s = place.s + sign * place.to_kerb;
        (stretch.line.at(s), stretch.along(stretch.line.segment_at(s)) * sign)
    }

    fn light(&self, which: usize, surroundings: &Surroundings<'_>) -> WalkLight {
        if !self.crossings[which].light {
            return WalkLight::ALWAYS;
        }
        surroundings.lights.get(which).copied().unwrap_or(WalkLight::ALWAYS)
    }

    /// Whether people may go, and for long enough.
    fn lasts(&self, w: &Walker, place: &AtCrossing, light: WalkLight) -> bool {
        let start = if w.velocity.norm() < 0.5 { START_UP } else { 0.0 };
        light.may_go && light.seconds_left > place.to_end / (w.pace() * BRISK) + start
    }

    /// Whether every vehicle that comes leaves time or can stop.
    fn let_go(&self, w: &Walker, place: &AtCrossing, surroundings: &Surroundings<'_>) -> bool {
        let start = if w.velocity.norm() < 0.5 { START_UP } else { 0.0 };
        let pace = w.pace() * BRISK;
        let depth = self.depths[place.which];
        surroundings.approaches.iter().filter(|a| a.crossing == place.which).all(|a| {
            let (near, far) = place.strip(a.strip());
            let (from, to) = a.occupied(depth);
            let (reach, clear) = (near.max(0.0) / pace + start, far / pace + start);
            far <= 0.0 || to + AFTER < reach || from > clear + BEFORE || a.can_stop()
        })
    }

    /// How fast somebody on the road may go without walking before a vehicle that will not stop.
    fn before_vehicles(&self, place: &AtCrossing, pace: f64, surroundings: &Surroundings<'_>) -> f64 {
        let mut most = f64::INFINITY;
        let depth = self.depths[place.which];
        for approach in surroundings.approaches.iter().filter(|a| a.crossing == place.which) {
            let (near, far) = place.strip(approach.strip());
            // Who is on the strip already goes on.
            if near < 0.1 {
                continue;
            }
            let (from, to) = approach.occupied(depth);
            let stops = approach.distance > 0.0
                && approach.speed * approach.speed < 2.0 * EXPECTED * (approach.distance - 0.5).max(0.0);
            if to < near / pace || from > far / pace + 0.5 * BEFORE || stops {
                continue;
            }
            most = most.min((2.0 * BRAKE_HARD * (near - 0.1)).sqrt());
        }
        most
    }

    /// Whether somebody who waits too stands right before.
    fn queues(&self, w: &Walker) -> bool {
        self.walkers.iter().any(|other| {
            let d = other.position - w.position;
            other.id != w.id
                && other.velocity.norm_squared() < 0.01
                && d.norm() < w.radius + other.radius + 0.25
                && d.dot(&w.facing) > 0.5 * d.norm()
        })
    }

    /// Companions keep together: who is behind hurries, who is ahead waits.
    fn together(&self, w: &Walker, speed: f64) -> f64 {
        let first = w.id - w.rank as u64;
        let Some(lead) = self.walkers.iter().find(|o| o.id == first) else { return speed };
        let half = self.network.stretches[w.stretch].half;
        if lead.stretch != w.stretch || lead.forward != w.forward || speed <= 0.0 {
            return speed;
        }
        let behind = (lead.s - w.s) * w.sign();
        let wanted = if w.abreast(half) { 0.0 } else { 1.15 * w.rank as f64 };
        speed * (1.0 + 0.25 * (behind - wanted)).clamp(0.6, 1.2)
    }

    /// The point of the way that lies so many metres ahead.
    fn target(&self, w: &Walker, look: f64) -> Vec2 {
        let stretch = &self.network.stretches[w.stretch];
        let remaining = self.remaining(w);
        let here =
            |ahead: f64| stretch.point(w.s + w.sign() * ahead, w.offset(stretch, w.forward), w.segment);
        if remaining > look {
            return here(look);
        }
        let Some((next, forward)) = self.onward(w) else { return here(look) };
        let ahead = (look - remaining).max(0.05);
        let stretch = &self.network.stretches[next];
        let length = stretch.line.length();
        let (s, near) =
            if forward { (ahead.min(length), 0) } else { ((length - ahead).max(0.0), usize::MAX) };
        stretch.point(s, w.offset(stretch, forward), near)
    }
}

impl AtCrossing {
    /// How far it is to a strip of the crossing between two arc lengths, and past it, metres.
    fn strip(&self, (low, high): (f64, f64)) -> (f64, f64) {
        if self.forward { (low - self.s, high - self.s) } else { (self.s - high, self.s - low) }
    }
}
