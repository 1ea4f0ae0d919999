//! Parameters of the stage.

use serde::Deserialize;

/// Parameters from the card of this stage.
#[derive(Clone, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Settings {
    /// Largest magnitude of the acceleration, m/s².
    pub acceleration: f64,
    /// Largest magnitude of the curvature as the metric computes it, 1/m.
    pub curvature: f64,
    /// Largest magnitude of the jerk, m/s³.
    pub jerk: f64,
    /// Largest lateral acceleration that a path may require, m/s².
    pub lateral_acceleration: f64,
    /// Standstill gap to the leader or obstacle ahead, metres.
    pub gap: f64,
    /// Smallest time to collision with a leader, seconds.
    pub closing_time: f64,
    /// Deceleration at which the AV may brake at any time, m/s².
    pub av_brake: f64,
    /// Deceleration with which a vehicle would respond to a braking AV, m/s².
    pub own_brake: f64,
    /// Lateral clearance to obstacles, metres.
    pub side: f64,
    /// Lateral clearance to the AV, metres.
    pub av_side: f64,
    /// Distance of the box centre from the edge of the drivable area, metres.
    pub inside: f64,
    /// Violation in metres up to which a plan counts as clear; beyond it other modes are tried.
    pub low_slack: f64,
}
