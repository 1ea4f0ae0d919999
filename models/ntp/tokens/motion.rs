//! Motions: poses relative to another pose.

use reactsim_geometry::{Vec2, direction, into_frame, left, wrap};
use reactsim_scene::dynamics::Pose;

/// The pose at the origin with heading along x, which is no motion.
pub const ORIGIN: Pose = Pose { position: Vec2::new(0.0, 0.0), heading: 0.0 };

/// Returns the motion from one pose to another: `to` in the frame of `from` (x ahead, y left). The
/// heading is wrapped.
pub fn motion_between(from: Pose, to: Pose) -> Pose {
    Pose {
        position: into_frame(direction(from.heading), to.position - from.position),
        heading: wrap(to.heading - from.heading),
    }
}

/// Returns the pose reached from a pose by a motion. The heading is wrapped.
pub fn moved(from: Pose, motion: Pose) -> Pose {
    let ahead = direction(from.heading);
    Pose {
        position: from.position + ahead * motion.position.x + left(ahead) * motion.position.y,
        heading: wrap(from.heading + motion.heading),
    }
}
