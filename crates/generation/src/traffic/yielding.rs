//! Places where drivers must wait: red lights, stop signs, traffic with right of way, people on crossings,
//! blocked exits of junctions.

mod conflicts;
mod people;
mod zipping;

use reactsim_scene::LightState;

use super::encounters::Encounters;
use super::network::Network;
use super::occupancy::LaneOccupancy;
use super::vehicle::Vehicle;
use crate::RightOfWay;

/// Braking, m/s², above which a driver passes a light that turns yellow (ITE: 3.05 m/s² for the yellow
/// interval).
const YELLOW_BRAKING: f64 = 3.0;
/// Time, s, within which a driver must cross the line in order to pass a yellow light: slightly less than
/// the shortest yellow (3 s).
const YELLOW_TIME: f64 = 2.8;
/// Maximum braking for a line or for people who might step out, m/s²: beyond it, it is too late to stop.
const LINE_BRAKING: f64 = 4.5;
/// Distance from the line, metres, within which a stop counts as a stop at the sign.
const SIGN_STOP_DISTANCE: f64 = 6.0;
/// Speed, m/s, below which a vehicle is standing.
const STANDSTILL_SPEED: f64 = 0.3;
/// Duration of a stop at a stop sign, s.
const SIGN_STOP_TIME: f64 = 1.0;
/// Acceleration of a vehicle that uses a gap, m/s².
const GAP_ACCELERATION: f64 = 1.6;
/// Speed, m/s, above which drivers merge with joining traffic without stopping.
const ZIP_SPEED: f64 = 1.0;
/// Maximum curvature of a lane for zip merging, 1/m.
const ZIP_CURVATURE: f64 = 0.02;
/// Constant part of the distance at which drivers look for places to wait, metres.
const SIGHT_DISTANCE: f64 = 12.0;
/// Part of that distance proportional to speed, s.
const SIGHT_TIME: f64 = 1.5;
/// Braking assumed in the stopping distance that adds to it, m/s².
const SIGHT_BRAKING: f64 = 1.3;
/// Distance from the line, metres, within which gaps are judged.
const GAP_DISTANCE: f64 = 45.0;
/// Distance before a conflict at which vehicles wait inside a junction, metres.
const CONFLICT_CLEARANCE: f64 = 1.5;
/// Minimum distance from the line to a conflict for waiting inside a signalised junction, metres.
const PULL_IN_DISTANCE_SIGNAL: f64 = 5.0;
/// Minimum distance from the line to a conflict for waiting inside an unsignalised junction, metres.
const PULL_IN_DISTANCE: f64 = 7.0;

/// State of traffic that drivers can see at one moment.
pub(super) struct Sight<'a> {
    pub(super) network: &'a Network,
    pub(super) vehicles: &'a [Vehicle],
    pub(super) occupancy: &'a LaneOccupancy,
    /// State of each signal plan.
    pub(super) lights: &'a [LightState],
    pub(super) encounters: &'a Encounters,
    /// Time since the beginning, s.
    pub(super) time: f64,
}

/// A place where a vehicle has to stop.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wait {
    /// Distance from the front bumper, metres.
    pub(super) distance: f64,
    /// The lane that is not entered; `None` when waiting inside a junction or for people.
    pub(super) lane: Option<usize>,
}

/// Memory of a driver about lights and signs ahead.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DriverMemory {
    /// The lane that is entered at yellow.
    pub(super) passes_yellow: Option<usize>,
    /// The lane in front of which the vehicle has stopped for a sign.
    pub(super) stopped_at_sign: Option<usize>,
}

impl Sight<'_> {
    /// Returns the nearest place within sight where a vehicle has to wait.
    pub(super) fn wait(&self, me: usize) -> (Option<Wait>, DriverMemory) {
        let v = &self.vehicles[me];
        let (fixed, time, braking) = (SIGHT_DISTANCE, SIGHT_TIME, SIGHT_BRAKING);
        let sight = fixed + time * v.speed + v.speed * v.speed / (2.0 * braking);
        let mut memory = DriverMemory { passes_yellow: v.passes_yellow, stopped_at_sign: None };
        let mut nearest: Option<Wait> = None;
        // It may be too late to stop; for obstacles drivers brake as hard as they can in any case.
        let mut offer = |wait: Wait, is_blocking: bool| {
            let possible = v.speed * v.speed < 2.0 * LINE_BRAKING * wait.distance.max(0.3) || v.speed < 1.0;
            if (possible || is_blocking) && nearest.is_none_or(|n| wait.distance < n.distance) {
                nearest = Some(wait);
            }
        };
        let mut start = 0.0;
        for (k, &index) in v.path.iter().enumerate() {
            let lane = &self.network.lanes[index];
            let line = start - v.front();
            if line > sight {
                break;
            }
            if let Some((distance, is_blocking)) = self.people(v, index, start) {
                offer(Wait { distance, lane: None }, is_blocking);
            }
            let before_line = k > 0 && line > -0.5;
            if before_line
                && (self.light_stops(v, index, line, &mut memory)
                    || self.sign_stops(v, index, line, &mut memory))
            {
                // A driver who cannot stop at the preferred distance stops closer to the line.
                let liked = line - v.driver.line_gap;
                let gentle = v.speed * v.speed < 2.0 * YELLOW_BRAKING * liked;
                let distance = if gentle || v.speed < STANDSTILL_SPEED { liked } else { line - 0.3 };
                offer(Wait { distance, lane: Some(index) }, false);
            } else if before_line && lane.connector && line < GAP_DISTANCE && self.is_blocked_behind(me, k) {
                offer(Wait { distance: line - v.driver.line_gap, lane: Some(index) }, false);
            } else if line < GAP_DISTANCE
                && let Some((conflict, has_standing)) = self.first_conflict(me, k, start)
            {
                let inside = Wait { distance: line + conflict.mine[0] - CONFLICT_CLEARANCE, lane: None };
                // At a green light, vehicles wait inside the junction, so that they can clear it when the
                // light changes. They also pull in where the turn begins well before the conflict, as into
                // driveways.
                let min_distance =
                    if lane.light.is_some() { PULL_IN_DISTANCE_SIGNAL } else { PULL_IN_DISTANCE };
                let signs = matches!(lane.rule, Some(RightOfWay::Stop | RightOfWay::AllWayStop));
                let pulls_in = !signs && conflict.mine[0] > min_distance + 0.5 * v.body.length;
                if before_line && !pulls_in {
                    offer(Wait { distance: line - v.driver.line_gap.min(1.5), lane: Some(index) }, false);
                } else {
                    offer(inside, has_standing);
                }
            }
            start += lane.length;
        }
        (nearest, memory)
    }

    fn light(&self, lane: usize) -> Option<LightState> {
        self.network.lanes[lane].light.map(|l| self.lights[l])
    }

    fn light_stops(&self, v: &Vehicle, lane: usize, line: f64, memory: &mut DriverMemory) -> bool {
        let Some(light) = self.light(lane) else { return false };
        if light.is_red() {
            return true;
        }
        if !light.is_yellow() {
            if memory.passes_yellow == Some(lane) {
                memory.passes_yellow = None;
            }
            return false;
        }
        if memory.passes_yellow == Some(lane) {
            return false;
        }
        let room = (line - 0.5).max(0.1);
        // The reaction takes time as well.
        let can_stop = v.speed * v.speed / (2.0 * (room - 0.4 * v.speed).max(0.1)) < YELLOW_BRAKING;
        let in_time = line < YELLOW_TIME * v.speed;
        if !can_stop && in_time {
            memory.passes_yellow = Some(lane);
        }
        can_stop || !in_time
    }

    fn sign_stops(&self, v: &Vehicle, lane: usize, line: f64, memory: &mut DriverMemory) -> bool {
        let rule = self.network.lanes[lane].rule;
        if !matches!(rule, Some(RightOfWay::Stop | RightOfWay::AllWayStop)) {
            return false;
        }
        let stands = v.speed < STANDSTILL_SPEED && line < SIGN_STOP_DISTANCE;
        if stands || v.stopped.is_some_and(|s| s.0 == lane) {
            memory.stopped_at_sign = Some(lane);
        }
        !v.stopped.is_some_and(|s| s.0 == lane && self.time - s.1 > SIGN_STOP_TIME)
    }
}
