//! Who goes first where ways cross or join: gap acceptance.

use super::super::following::time_for;
use super::super::lists::Coming;
use super::super::network::{Conflict, Duty};
use super::super::vehicle::Vehicle;
use super::{GOING, STANDS, Sight, ZIP_BEND, ZIP_FROM};
use crate::generation::RightOfWay;

/// How long one has waited when the accepted gap has shrunk to its smallest, s, and to which share.
const PATIENCE: f64 = 25.0;
const IMPATIENT: f64 = 0.5;
/// Acceleration of those who come, m/s².
const COMING: f64 = 0.5;
/// Who still stands at an all-way stop after this time does not hold up those who came later, s.
const STUCK: f64 = 12.0;

/// Who stands in a junction for longer than this is blocked, s.
const BLOCKED: f64 = 2.0;

impl Sight<'_> {
    /// Whether somebody stands behind the junction that begins with the `k`-th way of the path, so that there is no room for one more.
    pub(super) fn is_blocked_behind(&self, me: usize, k: usize) -> bool {
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

    /// The first stretch of the `k`-th way of the path, which begins `start` metres from where the path does, that can not be passed now;
    /// and whether somebody stands in it.
    pub(super) fn first_conflict(&self, me: usize, k: usize, start: f64) -> Option<(Conflict, bool)> {
        let v = &self.vehicles[me];
        let way = &self.network.ways[v.path[k]];
        let rule = way.rule;
        way.conflicts
            .iter()
            .filter(|c| start + c.mine[0] - v.front() > -0.3)
            .filter(|c| match (c.duty, rule) {
                (Duty::Equal, Some(RightOfWay::AllWayStop)) => {
                    self.is_taken(me, k, start, c) || k > 0 && self.came_earlier(me, c)
                }
                (Duty::GiveWay, _) => self.is_taken(me, k, start, c) || self.is_wanted(me, k, start, c),
                _ => self.is_taken(me, k, start, c),
            })
            .min_by(|a, b| a.mine[0].total_cmp(&b.mine[0]))
            .map(|c| (*c, self.is_stood_in(me, c)))
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

    /// Whether somebody stands in the stretch.
    fn is_stood_in(&self, me: usize, c: &Conflict) -> bool {
        self.lists.coming(c.other).iter().filter(|o| o.vehicle != me).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let half = 0.5 * other.body.length;
            other.speed < STANDS && o.at - half < c.theirs[1] && o.at + half > c.theirs[0]
        })
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
            // Of two who stand in each other's way one goes on, if the other is hardly in it.
            let blocked = |v: &Vehicle| v.speed < STANDS && self.time - v.standing_since > BLOCKED;
            let hardly = front < c.theirs[0] + 1.2 && (c.duty == Duty::GoFirst || v.id < other.id);
            if k == 0 && blocked(other) && blocked(v) && hardly {
                return false;
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
        self.lists.coming(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o)).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let (front, rear) = (o.at + 0.5 * other.body.length, o.at - 0.5 * other.body.length);
            if rear > c.theirs[1] {
                return false;
            }
            // Those who come to a bend will be slower there.
            let there = other.driver.in_bend(way.tightest()).min(other.speed);
            let room = c.theirs[0] - front;
            let arrives = if there < other.speed {
                2.0 * room.max(0.0) / (there + other.speed)
            } else {
                time_for(room, other.speed, COMING, way.limit.max(other.speed))
            };
            let leaves = (c.theirs[1] - rear) / there.max(1.0);
            // One who joins in front of somebody faster must not be run into.
            let faster = if c.joins { ((there - v.speed.max(3.0)) * 0.35).max(0.0) + 0.5 } else { 0.0 };
            arrives < leave + margin + faster && (leaves > enter - 0.4 || arrives > enter)
        })
    }

    /// Whether somebody who is coming to a way waits before it or before one of the ways on the path to it.
    pub(super) fn is_held(&self, o: &Coming) -> bool {
        let other = &self.vehicles[o.vehicle];
        let red = |w: &usize| self.light(*w).is_some_and(|l| l.is_red() && other.passes_yellow != Some(*w));
        o.ways > 0 && other.path[1..=o.ways].iter().any(|w| other.held == Some(*w) || red(w))
    }

    /// Whether somebody on the other way of an all-way stop may go before this one.
    fn came_earlier(&self, me: usize, c: &Conflict) -> bool {
        let v = &self.vehicles[me];
        let Some((_, mine)) = v.stopped else { return true };
        self.lists.coming(c.other).iter().any(|o| {
            let other = &self.vehicles[o.vehicle];
            o.vehicle != me
                && o.ways == 1
                && other.stopped.is_some_and(|(w, since)| {
                    // Who still stands after so long has reasons of their own.
                    w == c.other && self.time - since < STUCK && (since, other.id) < (mine, v.id)
                })
        })
    }
}
