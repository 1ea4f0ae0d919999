//! The state of ego, the vehicle that a planner drives, and the shape of its box.

use reactsim_geometry::{OrientedBox, Vec2, direction, math};

/// Box and axles of ego. The box is symmetric about the longitudinal axis of the vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EgoShape {
    /// Extent across the heading, metres.
    pub width: f64,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Distance between the axles, metres.
    pub wheelbase: f64,
    /// Distance from the rear axle forwards to the centre of the box, metres.
    pub rear_axle_to_center: f64,
}

impl EgoShape {
    /// The vehicle of every nuPlan scenario, a Chrysler Pacifica: 4.049 m of the box are before the rear axle
    /// and 1.127 m behind it (nuPlan devkit 1.2.2).
    pub const PACIFICA: Self =
        Self { width: 2.297, length: 5.176, wheelbase: 3.089, rear_axle_to_center: 1.461 };

    /// Returns the shape of a box whose axles are not recorded: they divide the length as in
    /// [`Self::PACIFICA`] (shares 0.59679 for the wheelbase and 0.28226 from the rear axle to the centre).
    /// `length` and `width` are in metres.
    pub fn from_box(length: f64, width: f64) -> Self {
        let scale = length / Self::PACIFICA.length;
        Self {
            width,
            length,
            wheelbase: Self::PACIFICA.wheelbase * scale,
            rear_axle_to_center: Self::PACIFICA.rear_axle_to_center * scale,
        }
    }

    /// Returns the box with its centre at `center` (m) and this heading (rad).
    pub(crate) fn footprint_at(&self, center: Vec2, heading: f64) -> OrientedBox {
        OrientedBox::new(center, heading, self.length, self.width)
    }
}

/// The state of ego at one time. The reference point is the centre of the rear axle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct EgoState {
    /// Time, seconds. The zero point is free.
    pub time: f64,
    /// Rear axle, metres, frame of the map.
    pub x: f64,
    /// Rear axle, metres, frame of the map.
    pub y: f64,
    /// Heading, radians counter-clockwise from the x axis of the map; need not be wrapped.
    pub heading: f64,
    /// Velocity of the rear axle along the heading, m/s, negative in reverse.
    pub vx: f64,
    /// Velocity of the rear axle to the left, m/s.
    pub vy: f64,
    /// Acceleration of the rear axle along the heading, m/s².
    pub ax: f64,
    /// Acceleration of the rear axle to the left, m/s².
    pub ay: f64,
    /// Steering angle of the front wheels, radians, positive to the left.
    pub steering: f64,
    /// Rate of the heading, rad/s.
    pub yaw_rate: f64,
    /// Rate of the yaw rate, rad/s².
    pub yaw_acceleration: f64,
}

impl EgoState {
    /// Returns a state at rest with its rear axle at `rear_axle` (m), at time 0.
    pub fn standing(rear_axle: Vec2, heading: f64) -> Self {
        Self {
            time: 0.0,
            x: rear_axle.x,
            y: rear_axle.y,
            heading,
            vx: 0.0,
            vy: 0.0,
            ax: 0.0,
            ay: 0.0,
            steering: 0.0,
            yaw_rate: 0.0,
            yaw_acceleration: 0.0,
        }
    }

    /// Returns the rear axle, metres, frame of the map.
    pub fn rear_axle(&self) -> Vec2 {
        Vec2::new(self.x, self.y)
    }

    /// Returns the centre of the box, metres, frame of the map.
    pub fn center(&self, shape: &EgoShape) -> Vec2 {
        self.rear_axle() + direction(self.heading) * shape.rear_axle_to_center
    }

    /// Returns the box.
    pub fn footprint(&self, shape: &EgoShape) -> OrientedBox {
        shape.footprint_at(self.center(shape), self.heading)
    }

    /// Returns the magnitude of the velocity of the rear axle, m/s. It is never negative, also in reverse.
    pub fn speed(&self) -> f64 {
        math::hypot(self.vx, self.vy)
    }

    /// Returns the magnitude of the acceleration of the rear axle, m/s².
    pub fn acceleration(&self) -> f64 {
        math::hypot(self.ax, self.ay)
    }

    /// Returns the acceleration of the centre of the box in the body frame, m/s², by the rule of nuPlan
    /// (devkit 1.2.2): `ax + d (ω² + α)` along the heading and `ay` to the left, where `d` is the distance
    /// from the rear axle to the centre.
    ///
    /// This is not the acceleration of a rigid body, `ax − d ω²` and `ay + d α`. The metrics of nuPlan depend
    /// on the rule.
    pub(crate) fn center_acceleration_nuplan(&self, shape: &EgoShape) -> Vec2 {
        let turning = self.yaw_rate * self.yaw_rate + self.yaw_acceleration;
        Vec2::new(self.ax + shape.rear_axle_to_center * turning, self.ay)
    }

    /// Returns whether all numbers are finite.
    pub fn is_finite(&self) -> bool {
        let pose = [self.time, self.x, self.y, self.heading];
        let motion =
            [self.vx, self.vy, self.ax, self.ay, self.steering, self.yaw_rate, self.yaw_acceleration];
        pose.into_iter().chain(motion).all(f64::is_finite)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_box_of_a_pacifica_begins_behind_the_rear_axle() {
        let state = EgoState::standing(Vec2::new(0.0, 0.0), 0.0);
        let corners = state.footprint(&EgoShape::PACIFICA).corners();
        assert!((corners[0] - Vec2::new(4.049, 1.1485)).norm() < 1e-12);
        assert!((corners[2] - Vec2::new(-1.127, -1.1485)).norm() < 1e-12);
    }

    #[test]
    fn the_axles_of_other_boxes_keep_the_shares_of_the_length() {
        let bus = EgoShape::from_box(12.0, 2.5);
        assert!((bus.rear_axle_to_center / 12.0 - 0.28226).abs() < 1e-5);
        assert!((bus.wheelbase / 12.0 - 0.59679).abs() < 1e-5);
        let pacifica = EgoShape::PACIFICA;
        assert_eq!(EgoShape::from_box(pacifica.length, pacifica.width), pacifica);
    }

    #[test]
    fn the_acceleration_of_the_centre_has_the_sign_of_nuplan() {
        let turning = EgoState {
            yaw_rate: 0.5,
            yaw_acceleration: 0.2,
            ay: 0.3,
            ..EgoState::standing(Vec2::zeros(), 0.0)
        };
        let center = turning.center_acceleration_nuplan(&EgoShape::PACIFICA);
        assert!((center - Vec2::new(1.461 * 0.45, 0.3)).norm() < 1e-12);
    }

    #[test]
    fn reversing_has_a_positive_speed() {
        let reversing = EgoState { vx: -3.0, ..EgoState::standing(Vec2::zeros(), 0.0) };
        assert_eq!(reversing.speed(), 3.0);
    }
}
