//! The kinematic bicycle model, parametrised by path curvature.

use reactsim_geometry::{Vec2, direction, math, wrap};

use crate::AgentState;

/// Position and heading of a vehicle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Box centre, metres.
    pub position: Vec2,
    /// Heading, radians.
    pub heading: f64,
}

impl From<AgentState> for Pose {
    fn from(state: AgentState) -> Self {
        Self { position: state.position(), heading: state.heading }
    }
}

impl Pose {
    /// Returns the pose after `distance` metres at constant curvature (1/m, left positive).
    ///
    /// The chord of the arc points along the mean of the two headings; its length is the arc length
    /// times sinc of half the turn.
    pub fn advance(&self, distance: f64, curvature: f64) -> Self {
        let half = 0.5 * curvature * distance;
        let sinc = if half.abs() < 1e-4 { 1.0 - half * half / 6.0 } else { math::sin(half) / half };
        Self {
            position: self.position + direction(self.heading + half) * (distance * sinc),
            heading: wrap(self.heading + 2.0 * half),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    #[test]
    fn a_quarter_circle_ends_where_it_should() {
        let start = Pose { position: Vec2::zeros(), heading: 0.0 };
        let end = start.advance(0.5 * PI * 10.0, 0.1);
        assert!((end.position - Vec2::new(10.0, 10.0)).norm() < 1e-12);
        assert!((end.heading - 0.5 * PI).abs() < 1e-12);
        assert_eq!(start.advance(3.0, 0.0).position, Vec2::new(3.0, 0.0));
    }
}
