//! Actions and the bicycle model of PufferDrive ("classic" dynamics).

use reactsim_geometry::{Vec2, direction, math, wrap};
use reactsim_scene::DT;
use reactsim_scene::dynamics::Pose;

/// Number of steering angles of the joint actions, from -1 to 1 rad.
const STEERING: usize = 13;

/// State of a vehicle in the policy's environment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Body {
    pub(super) pose: Pose,
    /// Speed, m/s, negative backwards.
    pub(super) speed: f64,
}

/// Returns the acceleration (m/s²) and the steering angle (rad) of a joint action.
fn action(index: usize) -> (f64, f64) {
    let (acceleration, steering) = (index / STEERING, index % STEERING);
    (4.0 * (acceleration as f64 - 3.0) / 3.0, (steering as f64 - 6.0) / 6.0)
}

/// Returns whether an action keeps the speed below a limit or brings it closer to the limit.
pub(super) fn keeps_limit(index: usize, speed: f64, limit: f64) -> bool {
    let (acceleration, _) = action(index);
    acceleration <= 0.0 && speed <= limit || acceleration < 0.0 || speed + acceleration * DT <= limit
}

impl Body {
    /// Returns the vehicle after one step of 0.1 s; `length` is its length, which the model uses as
    /// wheelbase.
    pub(super) fn moved(&self, index: usize, length: f64) -> Self {
        let (acceleration, steering) = action(index);
        let speed = self.speed + acceleration * DT;
        let (sin, cos) = math::sin_cos(steering);
        let tangent = sin / cos;
        let slip = math::tanh(0.5 * tangent);
        let turn = speed * math::cos(slip) * tangent / length * DT;
        let Pose { position, heading } = self.pose;
        let position: Vec2 = position + direction(heading + slip) * (speed * DT);
        Self { pose: Pose { position, heading: wrap(heading + turn) }, speed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_are_those_of_the_environment() {
        assert_eq!(action(0), (-4.0, -1.0));
        assert_eq!(action(3 * 13 + 6), (0.0, 0.0));
        assert_eq!(action(90), (4.0, 1.0));
        assert!(keeps_limit(90, 5.0, 10.0) && !keeps_limit(90, 9.9, 10.0));
        assert!(keeps_limit(3 * 13, 10.0, 10.0) && !keeps_limit(3 * 13, 11.0, 10.0));
        assert!(keeps_limit(0, 30.0, 10.0));
    }

    #[test]
    fn a_step_is_that_of_the_classic_bicycle() {
        let body = Body { pose: Pose { position: Vec2::zeros(), heading: 0.0 }, speed: 10.0 };
        let straight = body.moved(3 * 13 + 6, 4.5);
        assert_eq!(straight.pose, Pose { position: Vec2::new(1.0, 0.0), heading: 0.0 });
        let turned = body.moved(3 * 13 + 9, 4.5);
        let tangent = 0.5_f64.tan();
        let slip = (0.5 * tangent).tanh();
        assert!((turned.pose.position - Vec2::new(slip.cos(), slip.sin())).norm() < 1e-12);
        assert!((turned.pose.heading - 10.0 * slip.cos() * tangent / 4.5 * 0.1).abs() < 1e-12);
        assert!((body.moved(90, 4.5).speed - 10.4).abs() < 1e-12);
    }
}
