//! The frame of an agent, and the features of polylines in it.

use reactsim_geometry::{Vec2, direction, into_frame};
use reactsim_scene::dynamics::Pose;

/// Frame of an agent, which is at the origin and faces along x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalFrame {
    origin: Vec2,
    ahead: Vec2,
}

impl LocalFrame {
    pub(crate) fn of(pose: Pose) -> Self {
        Self { origin: pose.position, ahead: direction(pose.heading) }
    }

    /// Converts a point of the scene to this frame.
    pub(crate) fn point(&self, p: Vec2) -> Vec2 {
        into_frame(self.ahead, p - self.origin)
    }

    /// Converts a vector of the scene to this frame.
    pub(crate) fn vector(&self, v: Vec2) -> Vec2 {
        into_frame(self.ahead, v)
    }

    /// Returns the unit vector of a heading in this frame.
    pub(crate) fn toward(&self, heading: f64) -> Vec2 {
        into_frame(self.ahead, direction(heading))
    }

    /// Converts a vector of this frame to the scene.
    pub(crate) fn vector_out(&self, v: Vec2) -> Vec2 {
        self.ahead * v.x + Vec2::new(-self.ahead.y, self.ahead.x) * v.y
    }

    /// Converts a point of this frame to the scene.
    pub(crate) fn point_out(&self, p: Vec2) -> Vec2 {
        self.origin + self.vector_out(p)
    }
}

/// Features of polylines: `count` points of a fixed number of rows. Absent rows are zeros at the end.
#[derive(Clone, Debug, Default)]
pub(crate) struct PolylineFeatures {
    /// `[count, rows, numbers]`: features of the points.
    pub points: Vec<f32>,
    /// `[count, rows]`: 1 where a point is present.
    pub there: Vec<f32>,
}

impl PolylineFeatures {
    /// Creates zeros: no point is present.
    pub(crate) fn absent(count: usize, rows: usize, numbers: usize) -> Self {
        Self { points: vec![0.0; count * rows * numbers], there: vec![0.0; count * rows] }
    }
}
