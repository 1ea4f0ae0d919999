//! What the stage is asked to keep.

use serde::Deserialize;

/// The parameters of the card of this stage.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Largest magnitude of the acceleration, m/s².
    pub acceleration: f64,
    /// Largest magnitude of the curvature by the metric's formula, 1/m.
    pub curvature: f64,
    /// Largest change of the acceleration, m/s³.
    pub jerk: f64,
    /// Largest acceleration across the way that a path may ask for, m/s².
    pub lateral_acceleration: f64,
    /// Gap that is kept to what is ahead when it stands, metres.
    pub gap: f64,
    /// Time to collision that is kept, seconds.
    pub closing_time: f64,
    /// How hard the AV may brake at any time, m/s².
    pub av_brake: f64,
    /// How hard a vehicle would answer, m/s².
    pub own_brake: f64,
    /// Distance that is kept to what is passed, metres.
    pub side: f64,
    /// The same to the AV, metres.
    pub av_side: f64,
    /// How far inside the drivable ground the box centre stays, metres.
    pub inside: f64,
    /// A plan that fails to keep clear by more than this is not taken while there are others, metres.
    pub low_slack: f64,
}
