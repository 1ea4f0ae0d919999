//! Vehicle dynamics: the limits of the benchmark, the kinematic bicycle model, drivable paths and
//! the speeds at which they can be driven, and the tracker that follows planned poses within the
//! limits.
// Tests may call the mathematical functions of the platform: their comparisons have tolerances.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

mod axle_path;
mod bicycle;
mod driven_path;
mod limits;
mod motion_through;
mod tracker;

pub mod speeds;

pub use axle_path::{Allowed, AxlePath, CALM_STEERING_RATE, Departure, REAR_AXLE, follow, follow_smoothly};
pub use bicycle::Pose;
pub use driven_path::{DrivenPath, PathPoint, PathProjection, Pursuit};
pub use limits::{MAX_ACCELERATION, MAX_CURVATURE, PARKED_DISPLACEMENT, STANDSTILL_SPEED};
pub use motion_through::motion_through;
pub use tracker::{MotionLimits, Tracker, VehicleMotion};
