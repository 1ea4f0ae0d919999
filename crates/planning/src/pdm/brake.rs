//! The emergency brake of PDM-Closed (tuplan_garage b51d5d0, `PDMEmergencyBrake`).

use reactsim_geometry::direction;

use super::proposals::TRAJECTORY_STEPS;
use crate::trajectory::STEP;
use crate::{EgoShape, EgoState};

/// Largest time to an at-fault collision that triggers the brake, seconds (tuplan_garage b51d5d0,
/// `time_to_infraction_threshold`).
const COLLISION_TIME: f64 = 2.0;
/// Largest speed at which the brake acts, m/s (tuplan_garage b51d5d0, `max_ego_speed`).
const MAX_SPEED: f64 = 5.0;
/// Bounds of the commanded acceleration, m/s² (tuplan_garage b51d5d0, `min_long_accel` and
/// `max_long_accel`).
const ACCELERATION_BOUNDS: [f64; 2] = [-4.05, 2.40];
/// Speed in m/s above which the speed alone is controlled (tuplan_garage b51d5d0).
const MOVING_SPEED: f64 = 0.2;
/// Gain on the speed of a moving vehicle, 1/s (tuplan_garage b51d5d0, `k_p`).
const MOVING_GAIN: f64 = 10.0;
/// Gain on the speed of a slow vehicle, 1/s (tuplan_garage b51d5d0, `k_p`).
const SLOW_GAIN: f64 = 4.0;
/// Factor that compensates the gain 10/11 of the tracker (tuplan_garage b51d5d0).
const TRACKER_FACTOR: f64 = 1.1;

/// Returns whether the brake acts, for the time in seconds to the first at-fault collision of the best
/// proposal.
pub(super) fn is_necessary(ego: &EgoState, collision_time: f64) -> bool {
    collision_time <= COLLISION_TIME && ego.speed() <= MAX_SPEED
}

/// Returns the states of the brake: constant speed along the heading, velocities 0. The speed is chosen
/// so that the tracker brakes hard; it may be negative.
pub(super) fn states(ego: &EgoState, shape: &EgoShape) -> Vec<EgoState> {
    let speed = reference_speed(ego.vx, ego.center_acceleration_nuplan(shape).x);
    let ahead = direction(ego.heading);
    let state = |step: usize| {
        let elapsed = STEP * step as f64;
        let position = ego.rear_axle() + ahead * (speed * elapsed);
        EgoState { time: ego.time + elapsed, ..EgoState::standing(position, ego.heading) }
    };
    (0..=TRAJECTORY_STEPS).map(state).collect()
}

/// Returns the reference speed, m/s, for the speed (m/s) and the acceleration (m/s²) of the centre of ego.
fn reference_speed(speed: f64, acceleration: f64) -> f64 {
    let [lowest, highest] = ACCELERATION_BOUNDS;
    if speed > MOVING_SPEED {
        TRACKER_FACTOR * (speed + (-MOVING_GAIN * speed).clamp(lowest, highest))
    } else {
        (-SLOW_GAIN * speed - acceleration).clamp(lowest, highest)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_vehicles_back_up_in_the_reference() {
        assert!((reference_speed(4.0, 0.0) - 1.1 * (4.0 - 4.05)).abs() < 1e-12);
        assert!((reference_speed(0.1, 0.5) + 0.9).abs() < 1e-12);
        assert_eq!(reference_speed(-2.0, 0.0), 2.40);
    }
}
