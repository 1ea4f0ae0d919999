//! Where drivers must wait: red lights, stop signs, others who go first, people on crossings, junctions without room behind them.

mod conflicts;
mod people;
mod zipping;

use super::lists::Lists;
use super::network::Network;
use super::vehicle::Vehicle;
use crate::generation::RightOfWay;
use crate::geometry::Vec2;
use crate::scene::LightState;

/// Who would have to brake harder than this for a light that turns yellow goes on, m/s² (ITE: 3.05 m/s² for the yellow interval).
const FOR_YELLOW: f64 = 3.0;
/// Who would not be over the line within this time stops for a yellow light, s: a little less than the shortest yellow (3 s).
const YELLOW_LEFT: f64 = 2.8;
/// Nobody brakes harder than this for a line or for people who might step out, m/s²: it is too late then.
const FOR_LINE: f64 = 4.5;
/// How near the line one must have stopped, metres, and how slow that is, m/s.
const AT_LINE: f64 = 6.0;
const STANDS: f64 = 0.3;
/// How long one stands at a stop sign, s.
const SIGN_TIME: f64 = 1.0;
/// Acceleration of somebody who makes use of a gap, m/s².
const GOING: f64 = 1.6;
/// Drivers faster than this merge with those who join them, without stopping, m/s, where the way bends no more than this, 1/m.
const ZIP_FROM: f64 = 1.0;
const ZIP_BEND: f64 = 0.02;
/// How far drivers look ahead for places to wait: metres, s of their speed, and what they need to stop at this braking, m/s².
const SIGHT: (f64, f64, f64) = (12.0, 1.5, 1.3);
/// Gaps are judged from this distance on, metres.
const JUDGED: f64 = 45.0;
/// How far before a conflict one waits inside a junction, metres, and how far it must at least be from the line: with a
/// light, and without one.
const BEFORE_CONFLICT: f64 = 1.5;
const WORTH_PULLING_IN: (f64, f64) = (5.0, 7.0);

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
        let (fixed, time, braking) = SIGHT;
        let sight = fixed + time * v.speed + v.speed * v.speed / (2.0 * braking);
        let mut notes = Notes { passes_yellow: v.passes_yellow, stands_at_sign: None };
        let mut nearest: Option<Wait> = None;
        // It may be too late to stop; for what is in the way everybody brakes as hard as they can.
        let mut offer = |wait: Wait, in_the_way: bool| {
            let possible = v.speed * v.speed < 2.0 * FOR_LINE * wait.distance.max(0.3) || v.speed < 1.0;
            if (possible || in_the_way) && nearest.is_none_or(|n| wait.distance < n.distance) {
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
            if let Some((distance, in_the_way)) = self.people(v, w, start) {
                offer(Wait { distance, way: None }, in_the_way);
            }
            let before_line = k > 0 && line > -0.5;
            if before_line
                && (self.light_stops(v, w, line, &mut notes) || self.sign_stops(v, w, line, &mut notes))
            {
                // Who can not stop where they like to stops nearer to the line.
                let liked = line - v.driver.line_gap;
                let gentle = v.speed * v.speed < 2.0 * FOR_YELLOW * liked;
                let distance = if gentle || v.speed < STANDS { liked } else { line - 0.3 };
                offer(Wait { distance, way: Some(w) }, false);
            } else if before_line && way.connector && line < JUDGED && self.is_blocked_behind(me, k) {
                offer(Wait { distance: line - v.driver.line_gap, way: Some(w) }, false);
            } else if line < JUDGED
                && let Some((conflict, stood_in)) = self.first_conflict(me, k, start)
            {
                let inside = Wait { distance: line + conflict.mine[0] - BEFORE_CONFLICT, way: None };
                // With a green light one waits inside the junction, so as to get away when it ends.
                // So one does where the turn begins well before the conflict, as into driveways.
                let worth = if way.light.is_some() { WORTH_PULLING_IN.0 } else { WORTH_PULLING_IN.1 };
                let signs = matches!(way.rule, Some(RightOfWay::Stop | RightOfWay::AllWayStop));
                let pulls_in = !signs && conflict.mine[0] > worth + 0.5 * v.body.length;
                if before_line && !pulls_in {
                    offer(Wait { distance: line - v.driver.line_gap.min(1.5), way: Some(w) }, false);
                } else {
                    offer(inside, stood_in);
                }
            }
            start += way.length;
        }
        (nearest, notes)
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
            if notes.passes_yellow == Some(way) {
                notes.passes_yellow = None;
            }
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
}
