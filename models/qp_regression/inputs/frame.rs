//! The frame of an agent or a line, and the features of polylines in it.

use reactsim_dynamics::Pose;
use reactsim_geometry::{Vec2, direction, into_frame};

/// Number of features of a pose in another frame.
pub(crate) const POSE_FEATURES: usize = 8;

/// Frame of an agent or a line, which is at the origin and faces along x.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LocalFrame {
    origin: Vec2,
    ahead: Vec2,
}

impl LocalFrame {
    pub(crate) fn of(pose: Pose) -> Self {
        Self::at(pose.position, direction(pose.heading))
    }

    /// Creates the frame at this point that faces along this unit vector.
    pub(crate) fn at(origin: Vec2, ahead: Vec2) -> Self {
        Self { origin, ahead }
    }

    /// Returns the distance of the origin of another frame, metres.
    pub(crate) fn distance(&self, other: &Self) -> f64 {
        (other.origin - self.origin).norm()
    }

    /// Returns the pose of another frame in this one as features of about 1, the last one constant.
    pub(crate) fn pose_features(&self, other: &Self) -> [f64; POSE_FEATURES] {
        let (at, toward) = (self.point(other.origin), self.vector(other.ahead));
        let distance = at.norm();
        // The first two tell far positions apart, the next two near ones.
        let (far, near) = (at / 20.0, at / (2.0 + distance));
        [far.x, far.y, near.x, near.y, toward.x, toward.y, 1.0 / (1.0 + distance / 5.0), 1.0]
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
