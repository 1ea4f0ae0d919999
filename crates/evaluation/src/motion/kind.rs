//! Kinds of checks of given motion.

use std::fmt;
use std::str::FromStr;

/// A condition that given motion must meet unless the user allows otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum RolloutCheck {
    /// The AV follows the deviated trajectory of the scenario.
    Av,
    /// Agents continue from their last recorded state.
    Continuity,
    /// Positions are in the frame of the states that they continue.
    Coordinates,
    /// Positions are box centres.
    RearAxle,
    /// Lengths, speeds and times are in metres, m/s and steps of 0.1 s.
    Units,
    /// Motion continues from the latest frame.
    Time,
    /// Agents are in the order of the scenario.
    Order,
    /// Headings are radians counter-clockwise from the x axis, along the motion.
    Headings,
    /// Velocities are those of the positions.
    Velocities,
    /// No agent moves further in 0.1 s than its class can.
    Teleports,
    /// Moving agents do not stop dead.
    Freeze,
    /// World coordinates in 32 bits resolve a centimetre.
    Float32,
    /// Coordinates resolve a centimetre, in any other format.
    Resolution,
    /// Agents that the log contains are present.
    Presence,
    /// Every simulator has rollouts of every scenario.
    Coverage,
}

impl RolloutCheck {
    /// All checks.
    pub const ALL: [Self; 15] = [
        Self::Av,
        Self::Continuity,
        Self::Coordinates,
        Self::RearAxle,
        Self::Units,
        Self::Time,
        Self::Order,
        Self::Headings,
        Self::Velocities,
        Self::Teleports,
        Self::Freeze,
        Self::Float32,
        Self::Resolution,
        Self::Presence,
        Self::Coverage,
    ];

    /// Returns the name of what the user allows if the condition need not be met.
    pub const fn allowance(self) -> &'static str {
        match self {
            Self::Av => "other-av",
            Self::Continuity => "jumps",
            Self::Coordinates => "coordinates",
            Self::RearAxle => "rear-axle",
            Self::Units => "units",
            Self::Time => "time",
            Self::Order => "agent-order",
            Self::Headings => "headings",
            Self::Velocities => "velocities",
            Self::Teleports => "teleports",
            Self::Freeze => "freeze",
            Self::Float32 => "float32",
            Self::Resolution => "resolution",
            Self::Presence => "missing-agents",
            Self::Coverage => "partial",
        }
    }

    /// Returns the outcome that marks a rollout in which the check failed and was allowed.
    pub const fn outcome(self) -> &'static str {
        match self {
            Self::Av => "allowed-other-av",
            Self::Continuity => "allowed-jumps",
            Self::Coordinates => "allowed-coordinates",
            Self::RearAxle => "allowed-rear-axle",
            Self::Units => "allowed-units",
            Self::Time => "allowed-time",
            Self::Order => "allowed-agent-order",
            Self::Headings => "allowed-headings",
            Self::Velocities => "allowed-velocities",
            Self::Teleports => "allowed-teleports",
            Self::Freeze => "allowed-freeze",
            Self::Float32 => "allowed-float32",
            Self::Resolution => "allowed-resolution",
            Self::Presence => "allowed-missing-agents",
            Self::Coverage => "allowed-partial",
        }
    }
}

impl fmt::Display for RolloutCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.allowance())
    }
}

impl FromStr for RolloutCheck {
    type Err = String;

    /// Returns the check with this allowance.
    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::allowance).join(", ");
        let found = Self::ALL.into_iter().find(|check| check.allowance() == name);
        found.ok_or_else(|| format!("expected one of {}", known()))
    }
}
