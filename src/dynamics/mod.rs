//! What vehicles can do: the limits of the benchmark, the kinematic bicycle model, and paths that a vehicle can drive.

mod bicycle;
mod driven_path;
mod limits;

pub use bicycle::Pose;
pub use driven_path::{DrivenPath, PathPoint, PathProjection, Pursuit};
pub use limits::{MAX_ACCELERATION, MAX_CURVATURE};
