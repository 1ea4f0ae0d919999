//! A vehicle that is to be planned.

use reactsim_dynamics::VehicleMotion;
use reactsim_scene::Road;

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
}
