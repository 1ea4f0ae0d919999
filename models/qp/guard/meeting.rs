//! When a course comes too close to an obstacle.

use reactsim_geometry::OrientedBox;
use reactsim_scene::DT;

use super::super::obstacle::{Obstacle, TIMES, step_of};
use super::GuardSettings;
use super::course::Course;

/// Number of steps in which a vehicle minds others that are not planned yet and do not lead it: they will
/// mind it themselves.
const UNPLANNED_STEPS: usize = 10;
/// Speed in m/s from which the motion of an obstacle has a direction.
const MOVING_SPEED: f64 = 0.2;
/// Speed in m/s below which a vehicle that is run into is not at fault (`reactsim-metrics`, `STOPPED_SPEED`).
const STANDING_SPEED: f64 = 0.05;
/// Part of the speed of an obstacle along a vehicle's heading from which both move in the same direction.
const SAME_DIRECTION: f64 = 0.5;
/// Cosine of the largest difference of headings at which an AV ahead is approached: 75 degrees, as in the
/// metric of risky approaches.
const AHEAD_COSINE: f64 = 0.2588;
/// Lateral distance in metres up to which an AV counts as ahead.
const BESIDE: f64 = 0.1;
/// Distance in metres by which boxes that are too close from the start must come closer to count.
const CLOSER: f64 = 0.01;

/// A first meeting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meeting {
    /// Time until then, seconds.
    pub(super) time: f64,
    /// Whether the boxes come too close; otherwise only the time to collision is too short.
    pub(super) contact: bool,
    /// Whether an AV in reverse runs into the vehicle, which stands.
    pub(super) stands: bool,
}

impl GuardSettings {
    /// Returns the first time at which a course is too close to an obstacle; `None` if it never is. Agents
    /// other than the AV that follow behind do not count.
    pub(super) fn first_meeting(&self, course: &Course, obstacle: &Obstacle) -> Option<Meeting> {
        let (me, other) = (&course.boxes[0], &obstacle.boxes[0]);
        let ahead = (other.center - me.center).dot(&me.axis);
        let speed = obstacle.velocities[0].norm();
        let along = obstacle.velocities[0].dot(&me.axis) >= SAME_DIRECTION * speed && speed > MOVING_SPEED;
        if along && !obstacle.is_av && ahead < -(me.half_length + 0.5 * other.half_length) {
            return None;
        }
        let unplanned = obstacle.leader_only && !(along && ahead > 0.0) && !obstacle.stands();
        let clearance = if obstacle.is_av { self.av_clearance } else { self.clearance };
        let now = me.separation(other);
        let times = (1..TIMES).take_while(|&time| !unplanned || step_of(time) <= UNPLANNED_STEPS);
        for time in times {
            let (me, other) = (&course.boxes[time], &obstacle.boxes[time]);
            let closing = (course.speeds[time] - obstacle.speed(time)).max(0.0);
            let reach = me.half_length + me.half_width + other.half_length + other.half_width;
            let reach = reach + clearance + self.time_to_collision * closing;
            if (other.center - me.center).norm_squared() > reach * reach {
                continue;
            }
            let separation = me.separation(other);
            let contact = separation < clearance && separation < now - CLOSER;
            let risky = obstacle.is_av
                && gap_ahead(me, other).is_some_and(|gap| gap < self.time_to_collision * closing);
            if contact || risky {
                let backs = obstacle.is_av && obstacle.speed(time) < 0.0;
                let stands = backs && course.speeds[time] < STANDING_SPEED;
                return Some(Meeting { time: DT * step_of(time) as f64, contact, stands });
            }
        }
        None
    }
}

/// Returns the gap to a box ahead with a similar heading, metres; `None` if it is elsewhere.
fn gap_ahead(me: &OrientedBox, other: &OrientedBox) -> Option<f64> {
    let cos = me.axis.dot(&other.axis);
    let sin = me.axis.perp(&other.axis).abs();
    let to = other.center - me.center;
    let gap = to.dot(&me.axis) - me.half_length - (other.half_length * cos.abs() + other.half_width * sin);
    let beside =
        me.axis.perp(&to).abs() - me.half_width - (other.half_length * sin + other.half_width * cos.abs());
    (gap > 0.0 && beside < BESIDE && cos > AHEAD_COSINE).then_some(gap)
}
