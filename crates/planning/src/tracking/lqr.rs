//! Commands of the LQR tracker (nuPlan devkit 1.2.2, `LQRTracker`).

use reactsim_geometry::{direction, into_frame, wrap};

use super::Command;
use crate::trajectory::{Pose, STEP};

/// Number of steps over which the tracker looks ahead (nuPlan devkit 1.2.2, `tracking_horizon`).
pub const HORIZON: usize = 10;
/// Weight of the squared speed error at the horizon, per (m/s)² (nuPlan devkit 1.2.2, `q_longitudinal`).
const SPEED_WEIGHT: f64 = 10.0;
/// Weight of the squared acceleration, per (m/s²)² (nuPlan devkit 1.2.2, `r_longitudinal`).
const ACCELERATION_WEIGHT: f64 = 1.0;
/// Weight of the squared lateral error at the horizon, per m² (nuPlan devkit 1.2.2, `q_lateral`).
const LATERAL_WEIGHT: f64 = 1.0;
/// Weight of the squared heading error at the horizon, per rad² (nuPlan devkit 1.2.2, `q_lateral`). The
/// weight of the steering angle is 0.
const HEADING_WEIGHT: f64 = 10.0;
/// Weight of the squared steering rate, per (rad/s)² (nuPlan devkit 1.2.2, `r_lateral`).
const STEERING_RATE_WEIGHT: f64 = 1.0;
/// Speed in m/s: at most this fast, and with a reference at most this fast, the vehicle stops without
/// steering (nuPlan devkit 1.2.2, `stopping_velocity`).
const STOPPING_SPEED: f64 = 0.2;
/// Deceleration per speed error while stopping, 1/s (nuPlan devkit 1.2.2, `stopping_proportional_gain`).
const STOPPING_GAIN: f64 = 0.5;

/// The part of a reference that one command depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Target {
    /// Reference pose of the rear axle now.
    pub pose: Pose,
    /// Reference speed at the horizon, one second ahead, m/s.
    pub speed: f64,
    /// Reference curvatures of the steps up to the horizon, 1/m.
    pub curvatures: [f64; HORIZON],
}

/// Errors against the reference, and the steering angle: the state of the lateral system.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LateralState {
    /// Offset to the left of the reference pose, metres.
    pub offset: f64,
    /// Heading error, radians.
    pub heading: f64,
    /// Steering angle, radians.
    pub steering: f64,
}

impl LateralState {
    /// Returns the lateral state of a vehicle with `pose` and `steering` (rad) against a reference pose.
    pub fn new(pose: Pose, steering: f64, reference: Pose) -> Self {
        let error = into_frame(direction(reference.heading), pose.position - reference.position);
        Self { offset: error.y, heading: wrap(pose.heading - reference.heading), steering }
    }
}

/// Returns the command for a vehicle with the given lateral state, speed (m/s) and wheelbase (m).
///
/// Only the speed one second ahead is tracked: errors along the path are not corrected. The commands are
/// not clamped.
pub fn command(lateral: LateralState, speed: f64, target: &Target, wheelbase: f64) -> Command {
    if is_stopping(speed, target.speed) {
        return Command { acceleration: -STOPPING_GAIN * (speed - target.speed), steering_rate: 0.0 };
    }
    let acceleration = acceleration(speed, target.speed);
    let steering_rate = steering_rate(lateral, speed, acceleration, &target.curvatures, wheelbase);
    Command { acceleration, steering_rate }
}

/// Returns whether a vehicle stops without steering, by its speed and that of its reference, m/s.
pub fn is_stopping(speed: f64, reference: f64) -> bool {
    reference <= STOPPING_SPEED && speed <= STOPPING_SPEED
}

/// Returns the constant acceleration, m/s², that balances its weight against the speed error at the
/// horizon.
fn acceleration(speed: f64, reference: f64) -> f64 {
    let lookahead = HORIZON as f64 * STEP;
    let gain = SPEED_WEIGHT * lookahead / (SPEED_WEIGHT * lookahead * lookahead + ACCELERATION_WEIGHT);
    gain * (reference - speed)
}

/// Returns the constant steering rate, rad/s, that balances its weight against the lateral errors at the
/// horizon, for a vehicle of small angles that accelerates constantly.
fn steering_rate(
    initial: LateralState,
    speed: f64,
    acceleration: f64,
    curvatures: &[f64; HORIZON],
    wheelbase: f64,
) -> f64 {
    let mut state = initial;
    // Change of the state per steering rate.
    let mut response = LateralState { offset: 0.0, heading: 0.0, steering: 0.0 };
    for (step, curvature) in curvatures.iter().enumerate() {
        let advance = (speed + STEP * acceleration * step as f64) * STEP;
        state.offset += advance * state.heading;
        state.heading += advance * (state.steering / wheelbase - curvature);
        response.offset += advance * response.heading;
        response.heading += advance * response.steering / wheelbase;
        response.steering += STEP;
    }
    let gradient = LATERAL_WEIGHT * response.offset * state.offset
        + HEADING_WEIGHT * response.heading * wrap(state.heading);
    let curvature = LATERAL_WEIGHT * response.offset * response.offset
        + HEADING_WEIGHT * response.heading * response.heading
        + STEERING_RATE_WEIGHT;
    -gradient / curvature
}
