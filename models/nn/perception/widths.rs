//! Numbers of features of the parts of an agent's description.

/// Number of features of an agent's lane and of the paths along it.
pub(crate) const LANE_FEATURES: usize = OFFSET_FEATURES + LANE_PATHS * FEATURE_POINTS * 3;

/// Number of these that describe the agent's offset from its lane and its speed limit.
pub(super) const OFFSET_FEATURES: usize = 6;

/// Number of paths along a lane: the leftmost, the straightest and the rightmost.
pub(crate) const LANE_PATHS: usize = 3;

/// Number of points per path that enter the features.
pub(super) const FEATURE_POINTS: usize = 3;

/// Number of features of all candidate paths.
pub(crate) const CORRIDOR_FEATURES: usize = (1 + LANE_PATHS) * PATH_FEATURES;

/// Number of features per path.
pub(super) const PATH_FEATURES: usize = LOOK_AHEAD_TIMES.len() * TIME_FEATURES + STOP_FEATURES;

/// Times at which other agents are examined, seconds from now, at their present velocities.
pub(super) const LOOK_AHEAD_TIMES: [f64; 3] = [0.0, 1.0, 2.0];

/// Number of features per path and time.
pub(super) const TIME_FEATURES: usize = 7;

/// Number of features of the nearest stop on a path.
pub(super) const STOP_FEATURES: usize = 8;

/// Past poses that the network sees, in frames before the present one.
pub(super) const PAST_POSE_FRAMES: [usize; 4] = [1, 2, 5, 10];

/// Number of features per past pose: x and y in the present frame (forward, left), 1 - cosine and sine
/// of the turn, and a flag that the pose is known.
pub(super) const PAST_POSE_FEATURES: usize = 5;

/// Number of features of an agent at a step.
pub const BODY_FEATURES: usize = OWN_FEATURES + LANE_FEATURES + CORRIDOR_FEATURES;

/// Number of these that describe the agent's own motion; its lane and the agents ahead follow.
pub(super) const OWN_FEATURES: usize = MOTION_FEATURES + PAST_POSE_FRAMES.len() * PAST_POSE_FEATURES;

/// Number of features of class, size and present motion.
pub(super) const MOTION_FEATURES: usize = 14;
