//! The kinematic bicycle with lag (nuPlan devkit 1.2.2, `KinematicBicycleModel`).

use std::f64::consts::FRAC_PI_3;

use reactsim_geometry::{direction, math, wrap};

use crate::trajectory::STEP;
use crate::{EgoShape, EgoState};

/// Largest steering angle, radians (nuPlan devkit 1.2.2, `max_steering_angle`).
const MAX_STEERING: f64 = FRAC_PI_3;
/// Time constant of the acceleration, seconds (nuPlan devkit 1.2.2, `accel_time_constant`).
const ACCELERATION_TIME: f64 = 0.2;
/// Time constant of the steering angle, seconds (nuPlan devkit 1.2.2, `steering_angle_time_constant`).
const STEERING_TIME: f64 = 0.05;

/// Command of a tracker, or the part of it that takes effect in one step.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Command {
    /// Acceleration along the heading, m/s².
    pub acceleration: f64,
    /// Steering rate, rad/s.
    pub steering_rate: f64,
}

/// A kinematic bicycle whose reference point is the rear axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bicycle {
    wheelbase: f64,
}

impl Bicycle {
    /// Returns the bicycle of a vehicle.
    pub fn of(shape: &EgoShape) -> Self {
        Self { wheelbase: shape.wheelbase }
    }

    /// Returns the part of a command that takes effect in one step: acceleration and steering angle
    /// approach their commands with a lag.
    pub fn lagged(&self, state: &EgoState, command: Command) -> Command {
        let acceleration = state.ax + (command.acceleration - state.ax) * (STEP / (STEP + ACCELERATION_TIME));
        let steering_rate = command.steering_rate * (STEP / (STEP + STEERING_TIME));
        Command { acceleration, steering_rate }
    }

    /// Returns the state one step later. Positions and heading advance with the speed, heading and
    /// steering angle of the old state; the speed may become negative.
    pub fn advance(&self, state: &EgoState, command: Command) -> EgoState {
        let lagged = self.lagged(state, command);
        let rear_axle = state.rear_axle() + direction(state.heading) * (STEP * state.vx);
        let vx = state.vx + STEP * lagged.acceleration;
        let steering = (state.steering + STEP * lagged.steering_rate).clamp(-MAX_STEERING, MAX_STEERING);
        let yaw_rate = self.yaw_rate(vx, steering);
        EgoState {
            time: state.time + STEP,
            x: rear_axle.x,
            y: rear_axle.y,
            heading: wrap(state.heading + STEP * self.yaw_rate(state.vx, state.steering)),
            vx,
            vy: 0.0,
            ax: lagged.acceleration,
            ay: 0.0,
            steering,
            yaw_rate,
            yaw_acceleration: (yaw_rate - state.yaw_rate) / STEP,
        }
    }

    /// Returns the yaw rate, rad/s, at a speed (m/s) and a steering angle (rad).
    fn yaw_rate(&self, speed: f64, steering: f64) -> f64 {
        let (sin, cos) = math::sin_cos(steering);
        speed * (sin / cos) / self.wheelbase
    }
}

#[cfg(test)]
mod tests {
    use reactsim_geometry::Vec2;

    use super::*;

    #[test]
    fn commands_take_effect_with_a_lag() {
        let bicycle = Bicycle::of(&EgoShape::PACIFICA);
        let state = EgoState { vx: 5.0, ax: 1.0, ..EgoState::standing(Vec2::new(2.0, 3.0), 0.0) };
        let next = bicycle.advance(&state, Command { acceleration: 4.0, steering_rate: 0.3 });
        assert_eq!((next.x, next.y), (2.5, 3.0));
        assert!((next.ax - 2.0).abs() < 1e-12 && (next.vx - 5.2).abs() < 1e-12);
        assert!((next.steering - 0.02).abs() < 1e-12);
        assert!((next.yaw_rate - 5.2 * 0.02_f64.tan() / 3.089).abs() < 1e-12);
        assert!((next.yaw_acceleration - 10.0 * next.yaw_rate).abs() < 1e-12);
    }

    #[test]
    fn the_steering_angle_is_bounded() {
        let bicycle = Bicycle::of(&EgoShape::PACIFICA);
        let mut state = EgoState { vx: 1.0, ..EgoState::standing(Vec2::zeros(), 0.0) };
        for _ in 0..50 {
            state = bicycle.advance(&state, Command { acceleration: 0.0, steering_rate: 9.0 });
        }
        assert_eq!(state.steering, MAX_STEERING);
    }
}
