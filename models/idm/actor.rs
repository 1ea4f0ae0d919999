//! Agents and obstacles as moving boxes.

use reactsim_dynamics::Pose;
use reactsim_geometry::OrientedBox;
use reactsim_scene::AgentKind;

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
}
