//! Where drivers must wait: red lights, stop signs, others who go first, people on crossings, junctions without room behind them.

use super::following::{Leader, time_for};
use super::lists::{Coming, Lists};
use super::network::{Conflict, Duty, Network};
use super::vehicle::Vehicle;
use crate::generation::RightOfWay;
use crate::geometry::Vec2;
use crate::scene::LightState;

/// Who would have to brake harder than this for a light that turns yellow goes on, m/s² (ITE: 3.05 m/s² for the yellow interval).
const FOR_YELLOW: f64 = 3.0;
/// Who would not be over the line within this time stops for a yellow light, s: it is the shortest yellow.
const YELLOW_LEFT: f64 = 2.8;
/// Nobody brakes harder than this for a line or for people who might step out, m/s²: it is too late then.
const FOR_LINE: f64 = 4.5;
/// How near the line one must have stopped, metres, and how slow that is, m/s.
const AT_LINE: f64 = 6.0;
const STANDS: f64 = 0.3;
/// How long one stands at a stop sign, s.
const SIGN_TIME: f64 = 1.0;
/// How long one has waited when the accepted gap has shrunk to its smallest, s, and to which share.
const PATIENCE: f64 = 25.0;
const IMPATIENT: f64 = 0.5;
/// Acceleration of somebody who makes use of a gap, and of those who come, m/s².
const GOING: f64 = 1.6;
const COMING: f64 = 0.5;
/// From so far before the place where ways join drivers fall in behind one another, metres; at speeds above this, m/s; who has to give
/// way does so to those who are less than this behind, metres; and how hard they brake for it while there is time, m/s².
const ZIP: f64 = 80.0;
const ZIP_FROM: f64 = 1.0;
const ZIP_BIAS: f64 = 6.0;
const ZIP_BRAKING: f64 = 1.2;
/// Ways that bend no more than this join others at speed, 1/m.
const ZIP_BEND: f64 = 0.02;
/// After this time of everybody waiting for each other the first one goes, s.
const DEADLOCK: f64 = 7.0;
/// How far before a conflict one waits inside a junction, metres, and how far it must at least be from the line.
const BEFORE_CONFLICT: f64 = 1.5;
const WORTH_PULLING_IN: f64 = 5.0;

/// Somebody on foot who is on a crossing or about to step on it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Walker {
    /// Index of the footway.
    pub(super) footway: usize,
    pub(super) position: Vec2,
    pub(super) velocity: Vec2,
    /// Whether they stand at the kerb until drivers let them cross.
    pub(super) waits: bool,
}

/// What drivers can see at one moment.
pub(super) struct Sight<'a> {
    pub(super) network: &'a Network,
    pub(super) vehicles: &'a [Vehicle],
    pub(super) lists: &'a Lists,
    /// Per signal plan, what it shows.
    pub(super) lights: &'a [LightState],
    pub(super) walkers: &'a [Walker],
    /// Seconds since the beginning.
    pub(super) time: f64,
}

/// Where somebody has to stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    /// Metres from the front bumper.
    pub(super) distance: f64,
    /// The way that is not entered; none for those who wait inside a junction or for people.
    pub(super) way: Option<usize>,
}

/// What the driver remembers of it.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Notes {
    /// The way that is entered at yellow.
    pub(super) passes_yellow: Option<usize>,
    /// The way before which the vehicle stands as the sign asks.
    pub(super) stands_at_sign: Option<usize>,
}

impl Sight<'_> {
    /// The nearest place where a vehicle has to wait, within its sight.
    pub(super) fn wait(&self, me: usize) -> (Option<Wait>, Notes) {
        let v = &self.vehicles[me];
        let sight = 12.0 + v.speed * v.speed / (2.0 * 1.3) + v.speed * 1.5;
        let mut notes = Notes { passes_yellow: v.passes_yellow, stands_at_sign: None };
        let mut nearest: Option<Wait> = None;
        let mut offer = |wait: Wait| {
            if nearest.is_none_or(|n| wait.distance < n.distance) {
                nearest = Some(wait);
            }
        };
        let mut start = 0.0;
        for (k, &w) in v.path.iter().enumerate() {
            let way = &self.network.ways[w];
            let line = start - v.front();
            if line > sight {
                break;
            }
            if let Some(distance) = self.people(v, w, start) {
                offer(Wait { distance, way: None });
            }
            if k > 0 && line > -0.5 {
                if self.light_stops(v, w, line, &mut notes) || self.sign_stops(v, w, line, &mut notes) {
                    // Who can not stop where they like to stops nearer to the line.
                    let liked = line - v.driver.line_gap;
                    let gentle = v.speed * v.speed < 2.0 * FOR_YELLOW * liked;
                    let distance = if gentle || v.speed < STANDS { liked } else { line - 0.3 };
                    offer(Wait { distance, way: Some(w) });
                } else if !way.conflicts.is_empty() && line < sight.min(45.0) {
                    let no_room = self.network.ways[w].connector && self.is_blocked_behind(me, k);
                    if no_room {
                        offer(Wait { distance: line - v.driver.line_gap, way: Some(w) });
                    } else if let Some(conflict) = self.first_conflict(me, k, start) {
                        // With a green light one waits inside the junction, so as to get away when it ends.
                        let pull_in =
                            way.light.is_some() && conflict.mine[0] > WORTH_PULLING_IN + v.body.length * 0.5;
                        if pull_in {
                            offer(Wait { distance: line + conflict.mine[0] - BEFORE_CONFLICT, way: None });
                        } else {
                            offer(Wait { distance: line - v.driver.line_gap.min(1.5), way: Some(w) });
                        }
                    }
                }
            } else if !way.conflicts.is_empty()
                && let Some(conflict) = self.first_conflict(me, k, start)
            {
                offer(Wait { distance: start + conflict.mine[0] - BEFORE_CONFLICT - v.front(), way: None });
            }
            start += way.length;
        }
        let possible = |w: &Wait| v.speed * v.speed / (2.0 * w.distance.max(0.3)) < FOR_LINE || v.speed < 1.0;
        (nearest.filter(possible), notes)
    }

    fn light(&self, way: usize) -> Option<LightState> {
        self.network.ways[way].light.map(|l| self.lights[l])
    }

    fn light_stops(&self, v: &Vehicle, way: usize, line: f64, notes: &mut Notes) -> bool {
        let Some(light) = self.light(way) else { return false };
        if light.is_red() {
            return true;
        }
        if !light.is_yellow() {
            notes.passes_yellow = None;
            return false;
        }
        if notes.passes_yellow == Some(way) {
            return false;
        }
        let room = (line - 0.5).max(0.1);
        // The reaction takes its time too.
        let can_stop = v.speed * v.speed / (2.0 * (room - 0.4 * v.speed).max(0.1)) < FOR_YELLOW;
        let in_time = line < YELLOW_LEFT * v.speed;
        if !can_stop && in_time {
            notes.passes_yellow = Some(way);
        }
        can_stop || !in_time
    }

    fn sign_stops(&self, v: &Vehicle, way: usize, line: f64, notes: &mut Notes) -> bool {
        let rule = self.network.ways[way].rule;
        if !matches!(rule, Some(RightOfWay::Stop | RightOfWay::AllWayStop)) {
            return false;
        }
        let stands = v.speed < STANDS && line < AT_LINE;
        if stands || v.stopped.is_some_and(|s| s.0 == way) {
            notes.stands_at_sign = Some(way);
        }
        !v.stopped.is_some_and(|s| s.0 == way && self.time - s.1 > SIGN_TIME)
    }

    /// People on crossings of a way, or about to step there: how far ahead of the front bumper to stop.
    fn people(&self, v: &Vehicle, w: usize, start: f64) -> Option<f64> {
        let way = &self.network.ways[w];
        for &(footway, [from, to]) in &way.crossings {
            let distance = start + from - v.front() - 0.8;
            if distance < -0.5 {
                continue;
            }
            let arrives = time_for(distance, v.speed, GOING, way.limit);
            let leaves =
                time_for(distance + to - from + v.body.length + 1.0, v.speed.max(1.0), GOING, way.limit);
            let point = way.line.at(0.5 * (from + to));
            let side = crate::geometry::left(crate::geometry::direction(way.line.heading_at(from)));
            let near = 0.5 * v.body.width + 1.0;
            let meets = self.walkers.iter().filter(|p| p.footway == footway).any(|p| {
                let (at, speed) = ((p.position - point).dot(&side), p.velocity.dot(&side));
                if at.abs() < near + 0.4 {
                    return true;
                }
                if p.waits {
                    // Those who wait at the near kerb are let go by drivers who are polite and not too fast to stop at ease.
                    let nearly_there = at.abs() < 0.5 * way.half_width + 8.0;
                    return nearly_there
                        && v.driver.politeness > 0.15
                        && v.speed * v.speed < 2.0 * 1.8 * distance;
                }
                // Towards the vehicle's path: when do they reach it and leave it?
                let towards = -speed * at.signum();
                if towards < 0.2 {
                    return false;
                }
                let (enter, leave) = ((at.abs() - near) / towards, (at.abs() + near) / towards);
                enter < leaves + 1.5 && leave > arrives - 1.0
            });
            if meets {
                return Some(distance);
            }
        }
        None
    }

    /// Whether somebody stands behind the junction that begins with the `k`-th way of the path, so that there is no room for one more.
    fn is_blocked_behind(&self, me: usize, k: usize) -> bool {
        let v = &self.vehicles[me];
        let mut start = 0.0;
        for &w in &v.path[k..] {
            let way = &self.network.ways[w];
            if !way.connector {
                let room = v.body.length + v.driver.gap + 0.5;
                let last = self.lists.on(w).iter().find(|e| e.1 != me);
                return last.is_some_and(|&(at, i)| {
                    let other = &self.vehicles[i];
                    other.speed < 2.0 && at - 0.5 * other.body.length + 0.8 * other.speed * other.speed < room
                });
            }
            let stuck = self.lists.on(w).iter().any(|&(_, i)| {
                i != me && self.vehicles[i].speed < 0.3 && self.time - self.vehicles[i].standing_since > 2.0
            });
            if stuck && start == 0.0 && self.lists.on(w).len() > 1 {
                return true;
            }
            start += way.length;
        }
        false
    }

    /// The first stretch of the `k`-th way of the path, which begins `start` metres from where the path does, that can not be passed now.
    fn first_conflict(&self, me: usize, k: usize, start: f64) -> Option<Conflict> {
        let v = &self.vehicles[me];
        let way = &self.network.ways[v.path[k]];
        let rule = way.rule;
        way.conflicts
            .iter()
            .filter(|c| start + c.mine[0] - v.front() > -0.3)
            .filter(|c| match (c.duty, rule) {
                (Duty::Equal, Some(RightOfWay::AllWayStop)) => {
                    self.is_taken(me, k, start, c) || self.came_earlier(me, c)
                }
                (Duty::GiveWay, _) => self.is_taken(me, k, start, c) || self.is_wanted(me, k, start, c),
                _ => self.is_taken(me, k, start, c),
            })
            .min_by(|a, b| a.mine[0].total_cmp(&b.mine[0]))
            .copied()
    }

    /// When the vehicle reaches a conflict of the `k`-th way of its path and when it has left it, s.
    fn window(&self, me: usize, k: usize, start: f64, c: &Conflict) -> (f64, f64) {
        let v = &self.vehicles[me];
        let (to, past) = (start + c.mine[0] - v.front(), start + c.mine[1] - v.s + 0.5 * v.body.length);
        let way = &self.network.ways[v.path[k]];
        let top = v.driver.in_bend(way.tightest()).min(way.limit).max(v.speed);
        let acceleration = GOING.min(v.driver.acceleration);
        (time_for(to, v.speed, acceleration, top), time_for(past, v.speed, acceleration, top))
    }

    /// Whether somebody is in the stretch, or will not be out of it in time.
    fn is_taken(&self, me: usize, k: usize, start: f64, c: &Conflict) -> bool {
        let (enter, _) = self.window(me, k, start, c);
        let v = &self.vehicles[me];
        let to_it = start + c.mine[0] - v.front();
        self.lists.coming(c.other).iter().filter(|o| o.vehicle != me).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let (front, rear) = (o.at + 0.5 * other.body.length, o.at - 0.5 * other.body.length);
            if rear > c.theirs[1] {
                return false;
            }
            if front < c.theirs[0] - 0.3 {
                // Not there yet. Who has left the line goes first before those who have not, and before those who are farther from it.
                let left = o.ways == 0 && front > 1.0 && !c.joins && c.duty == Duty::Equal;
                return left && (k > 0 || (c.theirs[0] - front, other.id) < (to_it, v.id));
            }
            if c.joins {
                // Who is ahead on the other way is followed, not waited for, once both are in the stretch.
                return to_it > 0.0 && other.speed < 1.0 && rear < c.theirs[0] + 2.0;
            }
            let leaves = (c.theirs[1] - rear) / other.speed.max(0.5);
            leaves > enter - 0.3
        })
    }

    /// Whether somebody who goes first is coming and would be hindered.
    fn is_wanted(&self, me: usize, k: usize, start: f64, c: &Conflict) -> bool {
        if c.joins
            && self.vehicles[me].speed > ZIP_FROM
            && self.network.ways[self.vehicles[me].path[k]].tightest() < ZIP_BEND
        {
            return false;
        }
        let (enter, leave) = self.window(me, k, start, c);
        let v = &self.vehicles[me];
        let waited = (self.time - v.standing_since).clamp(0.0, PATIENCE) / PATIENCE;
        let margin = v.driver.margin * (1.0 - (1.0 - IMPATIENT) * waited);
        let way = &self.network.ways[c.other];
        self.lists.coming(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o, c.other)).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let (front, rear) = (o.at + 0.5 * other.body.length, o.at - 0.5 * other.body.length);
            if rear > c.theirs[1] {
                return false;
            }
            let arrives = time_for(c.theirs[0] - front, other.speed, COMING, way.limit.max(other.speed));
            let leaves = (c.theirs[1] - rear) / other.speed.max(1.0);
            // One who joins in front of somebody faster must not be run into.
            let faster = if c.joins { ((other.speed - v.speed.max(3.0)) * 0.35).max(0.0) + 0.5 } else { 0.0 };
            arrives < leave + margin + faster && (leaves > enter - 0.4 || arrives > enter)
        })
    }

    /// Where ways join at speed, drivers fall in behind one another well before (zip merging): how hard to brake for those who join ahead,
    /// m/s². Nearer to the end of the way goes first; who has to give way must be some metres ahead to do so.
    pub(super) fn falls_in(&self, me: usize) -> Option<f64> {
        let v = &self.vehicles[me];
        if v.speed < ZIP_FROM {
            return None;
        }
        let mut start = 0.0;
        let mut hardest: Option<f64> = None;
        for &w in &v.path {
            let way = &self.network.ways[w];
            if start - v.s > ZIP {
                break;
            }
            let mine = start + way.length - v.s;
            let ahead = ZIP_BIAS.min(1.0 + 0.5 * v.speed);
            for c in way.conflicts.iter().filter(|c| c.joins) {
                let bias = match c.duty {
                    Duty::GiveWay => ahead,
                    Duty::GoFirst => -ahead,
                    // Somebody has to be first.
                    Duty::Equal => {
                        if w < c.other {
                            0.1
                        } else {
                            -0.1
                        }
                    }
                };
                let other_way = &self.network.ways[c.other];
                for o in
                    self.lists.coming(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o, c.other))
                {
                    let other = &self.vehicles[o.vehicle];
                    let theirs = other_way.length - o.at;
                    let near = o.at > c.theirs[0] - ZIP && other.speed > ZIP_FROM;
                    if !near || theirs >= mine + bias || v.path.contains(&other.path[0]) {
                        continue;
                    }
                    let gap = mine - theirs - 0.5 * (v.body.length + other.body.length);
                    let wished = v.driver.behind(v.speed, Leader { gap: gap.max(0.5), speed: other.speed });
                    // There is time until the ways are one.
                    let left = (start + c.mine[0] - v.s).max(0.0);
                    let bounded = wished.max(-ZIP_BRAKING - 3.0 * (1.0 - left / ZIP).clamp(0.0, 1.0));
                    hardest = Some(hardest.map_or(bounded, |h: f64| h.min(bounded)));
                }
            }
            start += way.length;
        }
        hardest
    }

    /// Whether somebody who is coming to a way waits before it or before one of the ways on the path to it.
    fn is_held(&self, o: &Coming, way: usize) -> bool {
        let other = &self.vehicles[o.vehicle];
        let red = |w: &usize| self.light(*w).is_some_and(|l| l.is_red() && other.passes_yellow != Some(*w));
        let before = &other.path[1.min(o.ways)..=o.ways];
        o.ways > 0 && (before.iter().any(|w| other.held == Some(*w) || red(w)))
            || o.ways > 0 && self.network.ways[way].rule.is_some() && other.held == Some(way)
    }

    /// Whether somebody on the other way of an all-way stop may go before this one.
    fn came_earlier(&self, me: usize, c: &Conflict) -> bool {
        let v = &self.vehicles[me];
        let Some((_, mine)) = v.stopped else { return true };
        if self.time - mine > DEADLOCK {
            // Somebody has to begin: of those who have waited that long the one who came first in the list.
            let longer = |o: &Coming| {
                o.vehicle < me && self.vehicles[o.vehicle].stopped.is_some_and(|s| self.time - s.1 > DEADLOCK)
            };
            return self.lists.coming(c.other).iter().any(|o| o.ways == 1 && longer(o));
        }
        self.lists.coming(c.other).iter().any(|o| {
            let other = &self.vehicles[o.vehicle];
            o.vehicle != me
                && o.ways == 1
                && other.stopped.is_some_and(|(w, since)| w == c.other && (since, other.id) < (mine, v.id))
        })
    }
}
