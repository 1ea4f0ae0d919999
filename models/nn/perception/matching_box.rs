//! Boxes by which motions of a class are compared.

use reactsim_geometry::{Vec2, direction, left};
use reactsim_scene::dynamics::Pose;

use super::Class;

impl Class {
    /// Returns length and width in metres of the box that represents all agents of the class when
    /// motions are compared (SMART, CATK). The distance between its corners weighs position against
    /// heading.
    pub const fn matching_box(self) -> (f64, f64) {
        match self {
            Self::Vehicle => (4.8, 2.0),
            Self::Pedestrian => (1.0, 1.0),
            Self::Cyclist => (2.0, 1.0),
        }
    }

    /// Returns the corners of the matching box at a pose: left front, right front, right back, left
    /// back.
    pub fn contour(self, pose: Pose) -> [Vec2; 4] {
        let (length, width) = self.matching_box();
        let ahead = direction(pose.heading);
        let (along, across) = (ahead * (0.5 * length), left(ahead) * (0.5 * width));
        let p = pose.position;
        [p + along + across, p + along - across, p - along - across, p - along + across]
    }
}
