//! What a driver who gets out of the way may do, and from when on.

/// Bounds of a response. The defaults are those of a driver who brakes hard but not to the limit of the tyres.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AvoidanceSettings {
    /// Hardest braking, m/s².
    pub max_deceleration: f64,
    /// Hardest acceleration, m/s²; an agent that accelerates harder in its log may do that in its response.
    pub max_acceleration: f64,
    /// Largest change of acceleration, m/s³.
    pub max_jerk: f64,
    /// From the step at which something is visible to the last step at which the agent still moves as in the log, seconds: the step after
    /// it is the first that may differ.
    pub reaction: f64,
    /// A deviation from the log is visible beyond this distance, metres.
    pub visible_offset: f64,
    /// A deviation is visible beyond this difference of headings, radians.
    pub visible_heading: f64,
    /// A deviation is visible beyond this difference of speeds, m/s.
    pub visible_speed: f64,
    /// Largest sideways shift of a vehicle, metres; half of it is tried first. 0: never.
    pub max_nudge: f64,
    /// Lateral acceleration, m/s²: where the path bends, no response is faster than that allows, or than 1.1 times the speed of the log
    /// there, whichever is more. A shift takes as long as it takes with 0.6 of it.
    pub max_lateral_acceleration: f64,
    /// Distance that is kept from the AV (rounded boxes), metres.
    pub clearance: f64,
    /// Distance that is kept from others where the log keeps as much, metres.
    pub clearance_to_others: f64,
    /// Time to collision with the AV that is kept, seconds: the metric's bound and a little.
    pub time_gap: f64,
    /// Most agents with a response.
    pub max_agents: usize,
}

impl Default for AvoidanceSettings {
    fn default() -> Self {
        Self {
            max_deceleration: 5.0,
            max_acceleration: 2.0,
            max_jerk: 10.0,
            reaction: 0.3,
            visible_offset: 0.5,
            visible_heading: 6_f64.to_radians(),
            visible_speed: 1.0,
            max_nudge: 1.0,
            max_lateral_acceleration: 4.0,
            clearance: 0.2,
            clearance_to_others: 0.1,
            time_gap: 0.51,
            max_agents: 8,
        }
    }
}
