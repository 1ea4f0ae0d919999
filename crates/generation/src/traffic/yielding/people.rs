//! Yielding to people on crossings.

use reactsim_geometry::{direction, left};

use super::super::following::time_for;
use super::super::people::{Crosser, Intent};
use super::super::vehicle::Vehicle;
use super::{GAP_ACCELERATION, Sight};

/// Distance before a crossing at which drivers stop, metres.
const STOP_CLEARANCE: f64 = 0.8;
/// Lateral clearance between vehicles and people, metres.
const SIDE_CLEARANCE: f64 = 1.0;
/// Distance from a driver's path, metres, within which standing people wait at its kerb.
const KERB_DISTANCE: f64 = 9.0;
/// Politeness above which drivers stop for waiting people.
const MIN_POLITENESS: f64 = 0.15;
/// Maximum braking for waiting people, m/s².
const EASY_BRAKING: f64 = 1.8;
/// Time between a vehicle and a pedestrian who crosses its path, s.
const TIME_MARGIN: f64 = 1.2;

impl Sight<'_> {
    /// Checks for people on crossings of a lane, or about to step there. Returns the distance from the
    /// front bumper at which to stop, and whether the people already block the path.
    pub(super) fn people(&self, v: &Vehicle, index: usize, start: f64) -> Option<(f64, bool)> {
        let lane = &self.network.lanes[index];
        for &(footway, [from, to]) in &lane.crossings {
            let people = self.encounters.people_on(footway);
            let distance = start + from - v.front() - STOP_CLEARANCE;
            if distance < -0.5 && start + to > v.front() {
                // Already on the crossing: only people right ahead matter.
                let (nose, along) = (lane.line.at(v.front() - start), direction(lane.line.heading_at(from)));
                let ahead = |p: &Crosser| {
                    let to = p.position - nose;
                    let (before, beside) = (to.dot(&along), to.perp(&along).abs());
                    (0.0..3.0).contains(&before) && beside < 0.5 * v.body.width + 0.5
                };
                if people.iter().any(ahead) {
                    return Some((0.3, true));
                }
            }
            if distance < -0.5 || people.is_empty() {
                continue;
            }
            let arrives = time_for(distance, v.speed, GAP_ACCELERATION, lane.limit);
            let leaves = time_for(
                distance + to - from + v.body.length + SIDE_CLEARANCE,
                v.speed.max(1.0),
                GAP_ACCELERATION,
                lane.limit,
            );
            let point = lane.line.at(0.5 * (from + to));
            let side = left(direction(lane.line.heading_at(from)));
            let near = 0.5 * v.body.width + SIDE_CLEARANCE;
            let mut meets = None;
            for p in people {
                let (at, speed) = ((p.position - point).dot(&side), p.velocity.dot(&side));
                if at.abs() < near + 0.4 {
                    return Some((distance, true));
                }
                let hinders = || {
                    if p.intent == Intent::Waiting {
                        // Polite drivers who can stop gently let waiting people cross.
                        return at.abs() < KERB_DISTANCE
                            && v.driver.politeness > MIN_POLITENESS
                            && v.speed * v.speed < 2.0 * EASY_BRAKING * distance;
                    }
                    // Walking towards the vehicle's path: the times of reaching it and of leaving it.
                    let towards = -speed * at.signum();
                    if towards < 0.2 {
                        return false;
                    }
                    let (enter, leave) = ((at.abs() - near) / towards, (at.abs() + near) / towards);
                    enter < leaves + TIME_MARGIN && leave > arrives - TIME_MARGIN
                };
                if hinders() {
                    meets = Some((distance, false));
                }
            }
            if meets.is_some() {
                return meets;
            }
        }
        None
    }
}
