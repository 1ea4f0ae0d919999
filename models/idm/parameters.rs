//! Parameters, read from the card.

use reactsim::dynamics::Pursuit;
use serde::Deserialize;

/// Everything that the card sets.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parameters {
    pub(super) vehicle: Class,
    pub(super) cyclist: Class,
    pub(super) pedestrian: Pedestrian,
    pub(super) limits: Limits,
    pub(super) conflict: Conflict,
    pub(super) parked: Parked,
}

/// How a class of vehicles drives.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Class {
    /// Time headway T, s, and its relative spread over drivers.
    pub(super) headway: f64,
    pub(super) headway_spread: f64,
    /// Gap at standstill s0, m.
    pub(super) standstill_gap: f64,
    /// Maximum acceleration a and comfortable deceleration b, m/s².
    pub(super) acceleration: f64,
    pub(super) deceleration: f64,
    /// Coolness c of the ACC extension.
    pub(super) coolness: f64,
    /// Comfortable lateral acceleration in curves, m/s².
    pub(super) lateral_acceleration: f64,
    /// Steering: largest curvature, 1/m, and its change along the path, 1/m².
    pub(super) max_curvature: f64,
    pub(super) curvature_rate: f64,
    /// Desired speed where the limit is unknown, m/s: other roads, freeways.
    pub(super) speed_unknown_limit: f64,
    pub(super) speed_freeway: f64,
    /// Relative spread of the desired speed over drivers.
    pub(super) speed_spread: f64,
}

impl Class {
    /// How a path is steered onto a lane at this speed, m/s.
    pub(super) fn pursuit(&self, speed: f64) -> Pursuit {
        Pursuit {
            look_ahead: (0.9 * speed).clamp(5.0, 18.0),
            max_curvature: self.max_curvature,
            max_curvature_rate: self.curvature_rate,
        }
    }
}

/// How pedestrians walk.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Pedestrian {
    /// Slower ones stand, m/s.
    pub(super) standing_speed: f64,
    /// Room that they want to vehicles, m.
    pub(super) clearance: f64,
    /// How far they look ahead, s.
    pub(super) look_ahead: f64,
}

/// Bounds on the controls.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Limits {
    /// m/s².
    pub(super) emergency_deceleration: f64,
    /// m/s³, in normal driving and in emergencies.
    pub(super) jerk: f64,
    pub(super) emergency_jerk: f64,
}

/// Crossing and merging.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Conflict {
    /// How far others are predicted, s, and at which times.
    pub(super) horizon: f64,
    /// How far the AV is predicted for those who may have to get out of its way, s.
    pub(super) av_horizon: f64,
    pub(super) sample: f64,
    /// Room along the path to the AV and to others, m.
    pub(super) av_margin: f64,
    pub(super) margin: f64,
    /// Room in time to the AV, s: grows the room with the own speed.
    pub(super) av_time_margin: f64,
    /// Handicap of turning vehicles and of those that come from a stop sign when it is decided who goes first, s.
    pub(super) turn_penalty: f64,
    pub(super) stop_penalty: f64,
}

/// When a standing vehicle is taken for parked.
#[derive(Clone, Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Parked {
    /// Travel in the history below this, m.
    pub(super) travel: f64,
    /// Current speed below this, m/s.
    pub(super) speed: f64,
    /// Farther than this from the lane's centre line, m …
    pub(super) offset: f64,
    /// … or at a larger angle to it, rad.
    pub(super) heading: f64,
}
