//! The cheapest maneuver where a proposal leaves no way out.

use reactsim_geometry::{Vec2, direction, left, math};

use super::super::mode::Mode;
use super::super::planned_vehicle::PlannedVehicle;
use super::super::speed::STEPS;
use super::course::{Change, Course, Shift, after};
use super::meeting::Meeting;
use super::proposal::{Proposal, is_wrong_way};
use super::{GuardSettings, Surroundings};

/// Lateral shifts that are tried, metres.
const SHIFTS: [f64; 9] = [0.0, 0.6, -0.6, 1.2, -1.2, 1.8, -1.8, 2.6, -2.6];
/// Accelerations that are tried besides the proposed speed, m/s².
const ACCELERATIONS: [f64; 7] = [3.5, 1.5, 0.0, -1.5, -3.0, -4.5, -5.5];
/// Cost of a contact now.
const CONTACT_COST: f64 = 100.0;
/// Cost of a risky approach now.
const RISKY_COST: f64 = 40.0;
/// Part of the cost of a meeting that remains if an AV in reverse runs into the vehicle, which stands: it can
/// do no more.
const STANDING_PART: f64 = 0.25;
/// Time constant with which the cost of a later meeting decays, seconds: it may resolve itself.
const DECAY_TIME: f64 = 2.5;
/// Cost of moving aside.
const SHIFT_COST: f64 = 2.0;
/// Cost per metre of moving aside.
const COST_PER_METRE: f64 = 2.0;
/// Cost per m/s² of difference from the proposed acceleration.
const COST_PER_ACCELERATION: f64 = 0.6;
/// Cost of leaving the road with a side of the box.
const SIDE_OFF_ROAD_COST: f64 = 10.0;
/// Cost of leaving the road with the box centre.
const OFF_ROAD_COST: f64 = 60.0;
/// Cost of entering lanes of the opposite direction.
const WRONG_WAY_COST: f64 = 12.0;
/// Steps at which the ground of a shifted path is judged.
const JUDGED_STEPS: [usize; 4] = [8, 15, 22, 30];
/// Standard deviation of the modes of maneuvers along and across the motion, metres: they are to be followed
/// closely.
const SIGMA: f64 = 0.25;

/// Returns the mode along which the cheapest maneuver is planned; `None` if that is the proposal itself.
pub(super) fn cheapest(
    settings: &GuardSettings,
    vehicle: &PlannedVehicle<'_>,
    proposal: &Proposal<'_>,
    around: Surroundings<'_>,
) -> Option<Mode> {
    let proposed = proposal.acceleration(vehicle.now.speed.max(0.0));
    let changes = std::iter::once(Change::AsProposed).chain(ACCELERATIONS.map(Change::Now));
    let mut best = (f64::INFINITY, Shift::NONE, Change::AsProposed);
    for shift in SHIFTS.map(Shift) {
        let mut aside = 0.0;
        if shift != Shift::NONE {
            aside += SHIFT_COST + COST_PER_METRE * shift.0.abs();
            if aside < best.0 {
                aside += ground_cost(vehicle, proposal, shift);
            }
        }
        for change in changes.clone() {
            let mut cost = aside;
            if let Change::Now(acceleration) = change {
                cost += COST_PER_ACCELERATION * (acceleration - proposed).abs();
            }
            if cost >= best.0 {
                continue;
            }
            let course = Course::of(vehicle, proposal, shift, change);
            let others = around.others.iter().find_map(|o| settings.first_meeting(&course, o));
            cost += meeting_cost(others);
            if cost < best.0 {
                cost += av_cost(settings, &course, around);
            }
            if cost < best.0 {
                best = (cost, shift, change);
            }
        }
    }
    let (_, shift, change) = best;
    let changes = shift != Shift::NONE || change != Change::AsProposed;
    let point = |step| after(vehicle, proposal, shift, change, step).0.position;
    changes.then(|| Mode {
        points: (1..=STEPS).map(point).collect(),
        sigmas: Some(vec![[SIGMA; 2]; STEPS]),
        probability: 1.0,
    })
}

fn meeting_cost(meeting: Option<Meeting>) -> f64 {
    meeting.map_or(0.0, |m| {
        let cost = if m.contact { CONTACT_COST } else { RISKY_COST };
        let cost = if m.stands { cost * STANDING_PART } else { cost };
        cost * math::exp(-m.time / DECAY_TIME)
    })
}

/// Returns the cost of meeting the AV: between the worst and the weighted mean of its forecasts.
fn av_cost(settings: &GuardSettings, course: &Course, around: Surroundings<'_>) -> f64 {
    let (mut sum, mut worst, mut weights) = (0.0, 0.0_f64, 0.0);
    for (forecast, av) in around.av {
        let weight = settings.weight(*forecast);
        let cost = weight * meeting_cost(settings.first_meeting(course, av));
        (sum, worst, weights) = (sum + cost, worst.max(cost), weights + weight);
    }
    if weights == 0.0 {
        0.0
    } else {
        settings.worst_part * worst + (1.0 - settings.worst_part) * sum / weights
    }
}

/// Returns the cost of the ground of a shifted path: low for a side of the box off the road, high for its
/// centre and for lanes of the opposite direction.
fn ground_cost(vehicle: &PlannedVehicle<'_>, proposal: &Proposal<'_>, shift: Shift) -> f64 {
    let Some(road) = vehicle.road else { return 0.0 };
    let (mut near, mut lanes, mut cost) = (None, Vec::new(), 0.0_f64);
    for step in JUDGED_STEPS {
        let (pose, _) = after(vehicle, proposal, shift, Change::Now(0.0), step);
        let axis = direction(pose.heading);
        let side = left(axis) * vehicle.extent.width;
        for (aside, here) in
            [(side, SIDE_OFF_ROAD_COST), (-side, SIDE_OFF_ROAD_COST), (Vec2::zeros(), OFF_ROAD_COST)]
        {
            if road.drivable(pose.position + aside, &mut near) == Some(false) {
                cost = cost.max(here);
            }
        }
        if is_wrong_way(&road, pose.position, axis, &mut lanes) {
            cost = cost.max(WRONG_WAY_COST);
        }
    }
    cost
}
