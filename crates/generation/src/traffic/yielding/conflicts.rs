//! Gap acceptance: who goes first where lanes cross or join.

use super::super::following::time_for;
use super::super::network::{Conflict, Duty};
use super::super::occupancy::ApproachingVehicle;
use super::super::vehicle::Vehicle;
use super::{GAP_ACCELERATION, STANDSTILL_SPEED, Sight, ZIP_CURVATURE, ZIP_SPEED};
use crate::RightOfWay;

/// Waiting time after which the accepted gap has shrunk to its minimum, s.
const PATIENCE_TIME: f64 = 25.0;
/// Share of the accepted gap that is left after that time.
const IMPATIENT_SHARE: f64 = 0.5;
/// Assumed acceleration of approaching vehicles, m/s².
const APPROACH_ACCELERATION: f64 = 0.5;
/// Standing time at an all-way stop, s, after which a vehicle no longer holds up later ones.
const STUCK_TIME: f64 = 12.0;

/// Standing time inside a junction, s, after which a vehicle is blocked.
const BLOCKED_TIME: f64 = 2.0;
/// Room behind a junction beyond length and gap of the vehicle that enters it, metres.
const SPARE_ROOM: f64 = 0.5;
/// Speed below which the last vehicle behind a junction may leave no room, m/s.
const QUEUE_SPEED: f64 = 2.0;
/// Room that this vehicle makes by going on, per square of its speed, s²/m.
const ROOM_PER_SQUARED_SPEED: f64 = 0.8;
/// Speed below which a vehicle inside a junction is stuck, m/s.
const STUCK_SPEED: f64 = 0.3;
/// Distance by which a box may lie inside a conflict and still count as before it, metres.
const POSITION_TOLERANCE: f64 = 0.3;
/// Distance beyond the line from which a vehicle is inside the junction, metres.
const PAST_LINE_DISTANCE: f64 = 1.0;
/// Speed below which a vehicle that has hardly begun to join is waited for, m/s.
const JOINING_SPEED: f64 = 1.0;
/// Distance of its rear beyond the beginning of the conflict up to which it has hardly begun, metres.
const JOINING_DISTANCE: f64 = 2.0;
/// Distance up to which a vehicle is barely inside the conflict, metres.
const BARELY_INSIDE_DISTANCE: f64 = 1.2;
/// Least speed in the time that a vehicle inside the conflict takes to leave it, m/s.
const MIN_LEAVING_SPEED: f64 = 0.5;
/// Time by which a vehicle may reach the conflict before another one has left it, s.
const LEAVING_OVERLAP: f64 = 0.3;
/// The same for an approaching vehicle with right of way, s.
const APPROACH_OVERLAP: f64 = 0.4;
/// Least speed in the time that an approaching vehicle takes to pass the conflict, m/s.
const MIN_PASSING_SPEED: f64 = 1.0;
/// Least speed of the merging vehicle in the comparison with a faster one, m/s.
const MIN_MERGING_SPEED: f64 = 3.0;
/// Additional gap before a faster vehicle, seconds per m/s of difference.
const MERGE_GAP_PER_SPEED: f64 = 0.35;
/// Additional gap of any merge, s.
const MERGE_GAP: f64 = 0.5;

impl Sight<'_> {
    /// Whether a vehicle stands behind the junction that begins with the `k`-th lane of the path, so that
    /// there is no room for one more.
    pub(super) fn is_blocked_behind(&self, me: usize, k: usize) -> bool {
        let v = &self.vehicles[me];
        let mut start = 0.0;
        for &index in &v.path[k..] {
            let lane = &self.network.lanes[index];
            if !lane.connector {
                let room = v.body.length + v.driver.gap + SPARE_ROOM;
                let last = self.occupancy.on(index).iter().find(|e| e.1 != me);
                return last.is_some_and(|&(at, i)| {
                    let other = &self.vehicles[i];
                    let gained = ROOM_PER_SQUARED_SPEED * other.speed * other.speed;
                    other.speed < QUEUE_SPEED && at - 0.5 * other.body.length + gained < room
                });
            }
            let stuck = self.occupancy.on(index).iter().any(|&(_, i)| {
                let other = &self.vehicles[i];
                i != me && other.speed < STUCK_SPEED && self.time - other.standing_since > BLOCKED_TIME
            });
            if stuck && start == 0.0 && self.occupancy.on(index).len() > 1 {
                return true;
            }
            start += lane.length;
        }
        false
    }

    /// Returns the first conflict of the `k`-th lane of the path that cannot be passed now, and whether a
    /// vehicle stands in it. The lane begins `start` metres from the beginning of the path.
    pub(super) fn first_conflict(&self, me: usize, k: usize, start: f64) -> Option<(Conflict, bool)> {
        let v = &self.vehicles[me];
        let lane = &self.network.lanes[v.path[k]];
        let rule = lane.rule;
        lane.conflicts
            .iter()
            .filter(|c| start + c.mine[0] - v.front() > -POSITION_TOLERANCE)
            .filter(|c| match (c.duty, rule) {
                (Duty::Equal, Some(RightOfWay::AllWayStop)) => {
                    self.is_occupied(me, k, start, c) || k > 0 && self.came_earlier(me, c)
                }
                (Duty::GiveWay, _) => self.is_occupied(me, k, start, c) || self.is_claimed(me, k, start, c),
                _ => self.is_occupied(me, k, start, c),
            })
            .min_by(|a, b| a.mine[0].total_cmp(&b.mine[0]))
            .map(|c| (*c, self.has_standing_vehicle(me, c)))
    }

    /// Returns the times when the vehicle reaches a conflict of the `k`-th lane of its path and when it has
    /// cleared it, s.
    fn window(&self, me: usize, k: usize, start: f64, c: &Conflict) -> (f64, f64) {
        let v = &self.vehicles[me];
        let (to, past) = (start + c.mine[0] - v.front(), start + c.mine[1] - v.s + 0.5 * v.body.length);
        let lane = &self.network.lanes[v.path[k]];
        let top = v.driver.in_bend(lane.max_curvature).min(lane.limit).max(v.speed);
        let acceleration = GAP_ACCELERATION.min(v.driver.acceleration);
        (time_for(to, v.speed, acceleration, top), time_for(past, v.speed, acceleration, top))
    }

    /// Whether a vehicle stands in the stretch.
    fn has_standing_vehicle(&self, me: usize, c: &Conflict) -> bool {
        self.occupancy.approaching(c.other).iter().filter(|o| o.vehicle != me).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let half = 0.5 * other.body.length;
            other.speed < STANDSTILL_SPEED && o.at - half < c.theirs[1] && o.at + half > c.theirs[0]
        })
    }

    /// Whether a vehicle occupies the stretch, or will not clear it in time.
    fn is_occupied(&self, me: usize, k: usize, start: f64, c: &Conflict) -> bool {
        let (enter, _) = self.window(me, k, start, c);
        let v = &self.vehicles[me];
        let to_it = start + c.mine[0] - v.front();
        self.occupancy.approaching(c.other).iter().filter(|o| o.vehicle != me).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let (front, rear) = (o.at + 0.5 * other.body.length, o.at - 0.5 * other.body.length);
            if rear > c.theirs[1] {
                return false;
            }
            if front < c.theirs[0] - POSITION_TOLERANCE {
                // Not there yet. A vehicle that has passed the line goes before those that have not, and
                // before those farther from the conflict.
                let left =
                    o.lanes_before == 0 && front > PAST_LINE_DISTANCE && !c.joins && c.duty == Duty::Equal;
                return left && (k > 0 || (c.theirs[0] - front, other.id) < (to_it, v.id));
            }
            if c.joins {
                // Once both are in the stretch, the vehicle ahead on the other lane is followed, not waited
                // for.
                return to_it > 0.0 && other.speed < JOINING_SPEED && rear < c.theirs[0] + JOINING_DISTANCE;
            }
            // Of two vehicles that block each other, one proceeds if the other is barely in its stretch.
            let blocked =
                |v: &Vehicle| v.speed < STANDSTILL_SPEED && self.time - v.standing_since > BLOCKED_TIME;
            let hardly =
                front < c.theirs[0] + BARELY_INSIDE_DISTANCE && (c.duty == Duty::GoFirst || v.id < other.id);
            if k == 0 && blocked(other) && blocked(v) && hardly {
                return false;
            }
            let leaves = (c.theirs[1] - rear) / other.speed.max(MIN_LEAVING_SPEED);
            leaves > enter - LEAVING_OVERLAP
        })
    }

    /// Whether a vehicle with right of way is approaching and would be hindered.
    fn is_claimed(&self, me: usize, k: usize, start: f64, c: &Conflict) -> bool {
        if c.joins
            && self.vehicles[me].speed > ZIP_SPEED
            && self.network.lanes[self.vehicles[me].path[k]].max_curvature < ZIP_CURVATURE
        {
            return false;
        }
        let (enter, leave) = self.window(me, k, start, c);
        let v = &self.vehicles[me];
        let waited = (self.time - v.standing_since).clamp(0.0, PATIENCE_TIME) / PATIENCE_TIME;
        let margin = v.driver.margin * (1.0 - (1.0 - IMPATIENT_SHARE) * waited);
        let lane = &self.network.lanes[c.other];
        self.occupancy.approaching(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o)).any(|o| {
            let other = &self.vehicles[o.vehicle];
            let (front, rear) = (o.at + 0.5 * other.body.length, o.at - 0.5 * other.body.length);
            if rear > c.theirs[1] {
                return false;
            }
            // Vehicles that approach a bend will be slower there.
            let there = other.driver.in_bend(lane.max_curvature).min(other.speed);
            let room = c.theirs[0] - front;
            let arrives = if there < other.speed {
                2.0 * room.max(0.0) / (there + other.speed)
            } else {
                time_for(room, other.speed, APPROACH_ACCELERATION, lane.limit.max(other.speed))
            };
            let leaves = (c.theirs[1] - rear) / there.max(MIN_PASSING_SPEED);
            // A vehicle must not merge right in front of a faster one.
            let faster = there - v.speed.max(MIN_MERGING_SPEED);
            let faster = if c.joins { (faster * MERGE_GAP_PER_SPEED).max(0.0) + MERGE_GAP } else { 0.0 };
            arrives < leave + margin + faster && (leaves > enter - APPROACH_OVERLAP || arrives > enter)
        })
    }

    /// Whether an approaching vehicle waits before the lane or before an earlier lane on its path.
    pub(super) fn is_held(&self, o: &ApproachingVehicle) -> bool {
        let other = &self.vehicles[o.vehicle];
        let red = |index: &usize| {
            self.light(*index).is_some_and(|l| l.is_red() && other.passes_yellow != Some(*index))
        };
        o.lanes_before > 0
            && other.path[1..=o.lanes_before]
                .iter()
                .any(|index| other.held_before == Some(*index) || red(index))
    }

    /// Whether a vehicle on the other lane of an all-way stop may go before this one.
    fn came_earlier(&self, me: usize, c: &Conflict) -> bool {
        let v = &self.vehicles[me];
        let Some((_, mine)) = v.stopped else { return true };
        self.occupancy.approaching(c.other).iter().any(|o| {
            let other = &self.vehicles[o.vehicle];
            o.vehicle != me
                && o.lanes_before == 1
                && other.stopped.is_some_and(|(index, since)| {
                    // A vehicle that still stands after this long has its own reasons.
                    index == c.other && self.time - since < STUCK_TIME && (since, other.id) < (mine, v.id)
                })
        })
    }
}
