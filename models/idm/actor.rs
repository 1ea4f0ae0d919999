//! Agents and obstacles as moving boxes.

use reactsim_geometry::{OrientedBox, Vec2, wrap};
use reactsim_scene::AgentKind;
use reactsim_scene::dynamics::{DrivenPath, Pose};

/// Largest lateral offset at which an agent keeps to a path, metres.
const ON_PATH_OFFSET: f64 = 0.4;
/// Largest angle at which an agent keeps to a path, radians.
const ON_PATH_ANGLE: f64 = 0.1;
/// Smallest travel time left on a path that an agent keeps to, seconds.
const ON_PATH_TIME: f64 = 4.5;

/// An agent or obstacle at the present time of a plan.
#[derive(Clone, Copy, Debug)]
pub(super) struct Actor {
    pub(super) kind: AgentKind,
    pub(super) is_av: bool,
    pub(super) pose: Pose,
    /// Speed along the heading, m/s.
    pub(super) speed: f64,
    /// Acceleration along the heading, m/s².
    pub(super) acceleration: f64,
    pub(super) half_length: f64,
    pub(super) half_width: f64,
    /// Height of the road under it, metres; NaN if unknown, and in scenarios of one level.
    pub(super) height: f64,
}

impl Actor {
    /// Returns the distance of a corner from the centre, metres.
    pub(super) fn radius(&self) -> f64 {
        (self.half_length * self.half_length + self.half_width * self.half_width).sqrt()
    }

    /// Returns the present box.
    pub(super) fn footprint(&self) -> OrientedBox {
        OrientedBox::new(self.pose.position, self.pose.heading, 2.0 * self.half_length, 2.0 * self.half_width)
    }

    /// Returns its box at another place, enlarged on each side by these lengths along and across it, metres.
    pub(super) fn box_at(&self, center: Vec2, axis: Vec2, (along, across): (f64, f64)) -> OrientedBox {
        let (half_length, half_width) = (self.half_length + along, self.half_width + across);
        OrientedBox { center, axis, half_length, half_width }
    }

    /// Returns the arc length at which the agent is on a path, metres; `None` if it does not keep to the
    /// path, or will soon be at its end.
    pub(super) fn arc_on(&self, path: &DrivenPath) -> Option<f64> {
        let at = path.project(self.pose.position, 0, usize::MAX, None);
        let heading = path.points()[at.index].pose.heading;
        let keeps = at.offset.abs() < ON_PATH_OFFSET
            && wrap(heading - self.pose.heading).abs() < ON_PATH_ANGLE
            && path.length() - at.s > ON_PATH_TIME * self.speed;
        keeps.then_some(at.s)
    }
}
