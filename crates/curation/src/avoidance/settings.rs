//! Limits of the agents' responses.

/// Limits of a response. The defaults are those of a driver who brakes hard, but below the grip limit.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct AvoidanceSettings {
    /// Hardest braking, m/s².
    pub max_deceleration: f64,
    /// Hardest acceleration, m/s²; an agent that accelerates harder in its log may do so in its
    /// response.
    pub max_acceleration: f64,
    /// Largest change of acceleration, m/s³.
    pub max_jerk: f64,
    /// Reaction time, s: from the step at which a deviation becomes visible to the last step at which
    /// the agent still moves as in the log.
    pub reaction: f64,
    /// Distance from the logged position beyond which a deviation is visible, metres.
    pub visible_offset: f64,
    /// Difference from the logged heading beyond which a deviation is visible, radians.
    pub visible_heading: f64,
    /// Difference from the logged speed beyond which a deviation is visible, m/s.
    pub visible_speed: f64,
    /// Largest lateral shift of a vehicle, metres; half of it is tried first. 0 disables shifts.
    pub max_nudge: f64,
    /// Largest lateral acceleration in bends, m/s². It limits the speed of a response there, but never
    /// below 1.1 times the logged speed. The duration of a shift follows from 0.6 of it.
    pub max_lateral_acceleration: f64,
    /// Clearance to the AV (rounded boxes), metres.
    pub clearance: f64,
    /// Clearance to others where the log keeps as much, metres.
    pub clearance_to_others: f64,
    /// Smallest time to collision with the AV, seconds: slightly more than the metric's bound.
    pub time_gap: f64,
    /// Largest number of agents with a response.
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
