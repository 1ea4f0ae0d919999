//! Courses: where a vehicle is over the next seconds if it changes its speed or moves aside.

use reactsim_geometry::{OrientedBox, direction, left, math};
use reactsim_scene::DT;
use reactsim_scene::dynamics::Pose;

use super::super::obstacle::{TIMES, step_of};
use super::super::planned_vehicle::PlannedVehicle;
use super::proposal::Proposal;

/// Speed of a course.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Change {
    /// The proposed speed.
    AsProposed,
    /// The proposed speed during the committed steps, then this acceleration, m/s², at most to a halt.
    AfterCommitted(f64),
    /// This acceleration, m/s², from now on, at most to a halt.
    Now(f64),
}

/// Lateral shift of a course from the path of the proposal, metres, left positive.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Shift(pub(super) f64);

/// Time in seconds in which a vehicle moves 1 m aside; it grows with the root of the distance, so that the
/// lateral acceleration is the same, 4 m/s² at most.
const SHIFT_TIME: f64 = 1.2;
/// Length in metres in which a slow vehicle moves 1 m aside; it grows with the root of the distance, so that
/// the curvature is the same, 0.17 1/m at most.
const SHIFT_LENGTH: f64 = 6.0;

impl Shift {
    /// No shift.
    pub(super) const NONE: Self = Self(0.0);

    /// Returns offset and slope at an arc length for a vehicle with this speed, m/s.
    fn at(self, arc: f64, speed: f64) -> (f64, f64) {
        let root = self.0.abs().sqrt();
        let length = (SHIFT_TIME * root * speed).max(SHIFT_LENGTH * root);
        let u = (arc / length).clamp(0.0, 1.0);
        (self.0 * u * u * (3.0 - 2.0 * u), self.0 * 6.0 * u * (1.0 - u) / length)
    }
}

/// Boxes and speeds, m/s, of a vehicle at the times at which obstacles are known.
#[derive(Clone, Copy)]
pub(super) struct Course {
    pub(super) boxes: [OrientedBox; TIMES],
    pub(super) speeds: [f64; TIMES],
}

impl Course {
    /// Returns the course of a vehicle that follows the path of a proposal, or a path next to it.
    pub(super) fn of(
        vehicle: &PlannedVehicle<'_>,
        proposal: &Proposal<'_>,
        shift: Shift,
        change: Change,
    ) -> Self {
        let at: [(Pose, f64); TIMES] =
            std::array::from_fn(|time| after(vehicle, proposal, shift, change, step_of(time)));
        Self {
            boxes: at.map(|(pose, _)| vehicle.extent.at(pose.position, direction(pose.heading))),
            speeds: at.map(|(_, speed)| speed),
        }
    }
}

/// Returns pose and speed of a vehicle after a step.
pub(super) fn after(
    vehicle: &PlannedVehicle<'_>,
    proposal: &Proposal<'_>,
    shift: Shift,
    change: Change,
    step: usize,
) -> (Pose, f64) {
    let speed = vehicle.now.speed.max(0.0);
    let (arc, end) = match change {
        Change::AsProposed => proposal.progress(step),
        Change::AfterCommitted(_) if step <= proposal.committed() => proposal.progress(step),
        Change::AfterCommitted(a) => {
            let (arc, speed) = proposal.progress(proposal.committed());
            accelerated(arc, speed, a, DT * (step - proposal.committed()) as f64)
        }
        Change::Now(a) => accelerated(0.0, speed, a, DT * step as f64),
    };
    let pose = proposal.pose(arc);
    if shift == Shift::NONE {
        return (pose, end);
    }
    let (offset, slope) = shift.at(arc, speed);
    let position = pose.position + left(direction(pose.heading)) * offset;
    (Pose { position, heading: pose.heading + math::atan2(slope, 1.0) }, end)
}

/// Returns arc length and speed after a time at constant acceleration, at most to a halt.
fn accelerated(arc: f64, speed: f64, acceleration: f64, time: f64) -> (f64, f64) {
    let time = if acceleration < 0.0 { time.min(speed / -acceleration) } else { time };
    (arc + speed * time + 0.5 * acceleration * time * time, speed + acceleration * time)
}
