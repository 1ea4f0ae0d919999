//! A vehicle that is to be planned.

use reactsim_geometry::Vec2;
use reactsim_scene::Road;
use reactsim_scene::dynamics::VehicleMotion;

use super::obstacle::Extent;

/// A vehicle to be planned.
pub(super) struct PlannedVehicle<'a> {
    pub(super) now: VehicleMotion,
    /// Distance from the rear axle forward to the box centre, metres.
    pub(super) rear: f64,
    /// Half length and half width.
    pub(super) extent: Extent,
    /// Present curvature of the rear axle's path, 1/m; `None` at standstill or crawling speed.
    pub(super) curvature: Option<f64>,
    /// Road, if the vehicle is on its drivable area.
    pub(super) road: Option<Road<'a>>,
    /// Whether the corners of its box must stay on the road as well.
    pub(super) keeps_corners: bool,
}

impl PlannedVehicle<'_> {
    /// Returns the corners of its box at a centre and a heading (unit vector), metres; none if they may leave the
    /// road.
    pub(super) fn kept_corners(&self, centre: Vec2, axis: Vec2) -> impl Iterator<Item = Vec2> + use<> {
        self.keeps_corners.then(|| self.extent.at(centre, axis).corners()).into_iter().flatten()
    }
}
