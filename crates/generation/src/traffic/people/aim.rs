//! Directions and speeds at which pedestrians aim.

use reactsim_geometry::Vec2;

use super::walker::{Activity, Walker};
use super::{Crowd, Surroundings, WalkLight};

/// Look-ahead distance along the path, metres.
pub(super) const LOOK_AHEAD: f64 = 1.4;
/// Distance, metres, within which pedestrians consider a crossing.
const CROSSING_RANGE: f64 = 6.0;
/// Distance behind the kerb at which pedestrians wait, metres: no box is over the road.
const WAITING_SETBACK: f64 = 0.6;
/// Minimum distance of waiting pedestrians from the kerb, metres.
const MIN_SETBACK: f64 = 0.45;
/// Braking at kerbs, m/s².
const KERB_BRAKING: f64 = 0.9;
/// Braking in front of vehicles, m/s².
const VEHICLE_BRAKING: f64 = 1.8;
/// Walking speed on roads relative to that on footways (chosen).
const ROAD_SPEED_FACTOR: f64 = 1.06;
/// Walking speed on roads when time runs out, relative to that on footways.
const HURRY_SPEED_FACTOR: f64 = 1.3;
/// Time that pedestrians leave after a vehicle, seconds.
const TIME_AFTER: f64 = 0.5;
/// Time that pedestrians leave before a vehicle, seconds.
const TIME_BEFORE: f64 = 1.0;
/// Time that pedestrians need to start from standing, seconds.
const START_UP_TIME: f64 = 0.5;
/// Braking that pedestrians on the road still expect of approaching vehicles, m/s².
const EXPECTED_BRAKING: f64 = 4.0;

/// Intention of a pedestrian in one step.
#[derive(Clone, Copy, Debug)]
pub(super) struct Aim {
    /// Direction of walking, a unit vector.
    pub(super) towards: Vec2,
    /// Desired speed, m/s; 0 when standing.
    pub(super) speed: f64,
    /// The nearby crossing, if any.
    pub(super) crossing: Option<usize>,
    /// Whether stepping off the kerb looks possible.
    pub(super) clear: bool,
    /// The kerb that must not be passed now: a point, and the unit vector onto the road.
    pub(super) bar: Option<(Vec2, Vec2)>,
}

impl Aim {
    /// Keeps waiting pedestrians off the road even if others push: back to the kerb, or to their previous
    /// position if it is closer to the road.
    pub(super) fn held_back(&self, p: Vec2, from: Vec2) -> Vec2 {
        let Some((kerb, onto)) = self.bar else { return p };
        let over = |q: Vec2| (q - kerb).dot(&onto) + MIN_SETBACK;
        p - onto * (over(p) - over(from).max(0.0)).max(0.0)
    }
}

/// Position of a pedestrian relative to a crossing ahead or underfoot.
#[derive(Clone, Copy, Debug)]
pub(super) struct CrossingPosition {
    pub(super) which: usize,
    /// Whether the pedestrian walks along the direction of its line.
    pub(super) forward: bool,
    /// Arc length on its line, metres; before its beginning extrapolated straight.
    pub(super) s: f64,
    /// Distance to the kerb where the road begins, metres; negative on the road.
    pub(super) to_kerb: f64,
    /// Distance to the kerb where the road ends, metres.
    pub(super) to_end: f64,
}

impl Crowd {
    /// Returns the stretch after the current one, and whether it is walked along its line.
    pub(super) fn onward(&self, w: &Walker) -> Option<(usize, bool)> {
        let (_, node) = self.network.ahead(w);
        let next = self.network.next(w.goal, node)?;
        Some((next, self.network.stretches[next].ends[0] == node))
    }

    /// Returns the crossing that a pedestrian is on or approaches.
    pub(super) fn at_crossing(&self, w: &Walker) -> Option<CrossingPosition> {
        let place = |which: usize, forward: bool, s: f64| {
            let [a, b] = self.crossings[which].kerbs;
            let (to_kerb, to_end) = if forward { (a - s, b - s) } else { (s - b, s - a) };
            CrossingPosition { which, forward, s, to_kerb, to_end }
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
        let (remaining, _) = self.network.ahead(w);
        if remaining > CROSSING_RANGE {
            return None;
        }
        let (next, forward) = self.onward(w)?;
        let which = self.network.stretches[next].crossing?;
        Some(place(which, forward, self.straight_on(w, next, forward)))
    }

    /// Returns the arc length on a stretch for a pedestrian who is not on it yet, by straight-line distance
    /// (corners are cut) and straight extrapolation.
    fn straight_on(&self, w: &Walker, stretch: usize, forward: bool) -> f64 {
        let on = &self.network.stretches[stretch];
        let (begin, segment) = if forward { (0.0, 0) } else { (on.line.length(), on.line.segments() - 1) };
        let from = w.position - self.end(stretch, !forward);
        let ahead = from.dot(&on.along(segment));
        let aside = (from.perp(&on.along(segment)).abs() - on.half).max(0.0);
        begin + ahead + if forward { -aside } else { aside }
    }

    /// Returns an end of a stretch: the last point of its line, or the first.
    pub(super) fn end(&self, stretch: usize, last: bool) -> Vec2 {
        let points = self.network.stretches[stretch].line.points();
        if last { points[points.len() - 1] } else { points[0] }
    }

    /// Plans where to walk, and how fast.
    pub(super) fn aim(&self, w: &Walker, surroundings: &Surroundings<'_>) -> Aim {
        let mut aim = Aim { towards: w.facing, speed: 0.0, crossing: None, clear: false, bar: None };
        if matches!(w.activity, Activity::Standing(_)) {
            return aim;
        }
        aim.speed = w.pace();
        let mut look = LOOK_AHEAD;
        if let Some(place) = self.at_crossing(w) {
            aim.crossing = Some(place.which);
            let light = self.light(place.which, surroundings);
            if place.to_kerb > 0.0 {
                aim.clear = place.to_kerb < 2.0 * w.desired_speed + 1.0
                    && self.has_time(w, &place, light)
                    && self.traffic_allows(w, &place, surroundings);
                if !(aim.clear && w.looked >= w.reaction) {
                    let room = place.to_kerb - WAITING_SETBACK;
                    aim.speed = aim.speed.min((2.0 * KERB_BRAKING * room.max(0.0)).sqrt());
                    if room < 0.12 || (room < 2.0 && self.is_queued(w)) {
                        aim.speed = 0.0;
                    }
                    look = look.min(room.max(0.3));
                    aim.bar = Some(self.kerb(&place));
                }
            } else {
                let late = place.to_end > aim.speed * light.seconds_left;
                aim.speed *= if late { HURRY_SPEED_FACTOR } else { ROAD_SPEED_FACTOR };
                aim.speed = aim.speed.min(self.speed_before_vehicles(&place, aim.speed, surroundings));
            }
        }
        if w.rank > 0 {
            aim.speed = self.group_speed(w, aim.speed);
        }
        let towards = self.target(w, look) - w.position;
        let distance = towards.norm();
        if distance > 1e-6 {
            aim.towards = w.detour_direction(towards / distance);
        }
        aim
    }

    /// Returns the kerb ahead, and the unit vector onto the road.
    fn kerb(&self, place: &CrossingPosition) -> (Vec2, Vec2) {
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

    /// Whether the light lets people walk, and for long enough.
    fn has_time(&self, w: &Walker, place: &CrossingPosition, light: WalkLight) -> bool {
        let start = if w.velocity.norm() < 0.5 { START_UP_TIME } else { 0.0 };
        light.may_go && light.seconds_left > place.to_end / (w.pace() * ROAD_SPEED_FACTOR) + start
    }

    /// Whether every approaching vehicle leaves enough time or can stop.
    fn traffic_allows(&self, w: &Walker, place: &CrossingPosition, surroundings: &Surroundings<'_>) -> bool {
        let start = if w.velocity.norm() < 0.5 { START_UP_TIME } else { 0.0 };
        let pace = w.pace() * ROAD_SPEED_FACTOR;
        let depth = self.depths[place.which];
        surroundings.approaches.iter().filter(|a| a.crossing == place.which).all(|a| {
            let (near, far) = place.strip(a.strip());
            let (from, to) = a.occupied(depth);
            let (reach, clear) = (near.max(0.0) / pace + start, far / pace + start);
            far <= 0.0 || to + TIME_AFTER < reach || from > clear + TIME_BEFORE || a.can_stop()
        })
    }

    /// Returns the maximum speed with which a pedestrian on the road does not step in front of a vehicle
    /// that will not stop.
    fn speed_before_vehicles(
        &self,
        place: &CrossingPosition,
        pace: f64,
        surroundings: &Surroundings<'_>,
    ) -> f64 {
        let mut most = f64::INFINITY;
        let depth = self.depths[place.which];
        for approach in surroundings.approaches.iter().filter(|a| a.crossing == place.which) {
            let (near, far) = place.strip(approach.strip());
            // A pedestrian who is already on the vehicle's strip walks on.
            if near < 0.1 {
                continue;
            }
            let (from, to) = approach.occupied(depth);
            let stops = approach.distance > 0.0
                && approach.speed * approach.speed
                    < 2.0 * EXPECTED_BRAKING * (approach.distance - 0.5).max(0.0);
            if to < near / pace || from > far / pace + 0.5 * TIME_BEFORE || stops {
                continue;
            }
            most = most.min((2.0 * VEHICLE_BRAKING * (near - 0.1)).sqrt());
        }
        most
    }

    /// Whether another waiting pedestrian stands directly ahead.
    fn is_queued(&self, w: &Walker) -> bool {
        self.walkers.iter().any(|other| {
            let d = other.position - w.position;
            other.id != w.id
                && !self.are_apart(w, other)
                && other.velocity.norm_squared() < 0.01
                && d.norm() < w.radius + other.radius + 0.25
                && d.dot(&w.facing) > 0.5 * d.norm()
        })
    }

    /// Keeps companions together: those behind speed up, those ahead slow down.
    fn group_speed(&self, w: &Walker, speed: f64) -> f64 {
        let first = w.id - w.rank as u64;
        let Some(lead) = self.walkers.iter().find(|o| o.id == first) else { return speed };
        let half = self.network.stretches[w.stretch].half;
        if lead.stretch != w.stretch || lead.forward != w.forward || speed <= 0.0 {
            return speed;
        }
        let behind = (lead.s - w.s) * w.sign();
        speed * (1.0 + 0.25 * (behind - w.lag(half))).clamp(0.6, 1.2)
    }

    /// Returns the point of the path `look` metres ahead.
    fn target(&self, w: &Walker, look: f64) -> Vec2 {
        let stretch = &self.network.stretches[w.stretch];
        let (remaining, _) = self.network.ahead(w);
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

impl CrossingPosition {
    /// Returns the distances to the beginning and the end of a strip of the crossing, given by arc lengths,
    /// metres.
    fn strip(&self, (low, high): (f64, f64)) -> (f64, f64) {
        if self.forward { (low - self.s, high - self.s) } else { (self.s - high, self.s - low) }
    }
}
