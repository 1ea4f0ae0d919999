//! Kinds of checks of given motion.

use std::fmt;
use std::str::FromStr;

/// Defines the checks, each with the name of what the user allows if the condition need not be met.
macro_rules! checks {
    ($($(#[doc = $text:literal])+ $check:ident => $name:literal,)+) => {
        /// A condition that given motion must meet unless the user allows otherwise.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
        pub enum RolloutCheck {
            $($(#[doc = $text])+ $check,)+
        }

        impl RolloutCheck {
            /// All checks.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$check),+];

            /// Returns the name of what the user allows if the condition need not be met.
            pub const fn allowance(self) -> &'static str {
                match self {
                    $(Self::$check => $name,)+
                }
            }

            /// Returns the outcome that marks a rollout in which the check failed and was allowed.
            pub const fn outcome(self) -> &'static str {
                match self {
                    $(Self::$check => concat!("allowed-", $name),)+
                }
            }
        }
    };
}

checks! {
    /// The AV follows the deviated trajectory of the scenario.
    Av => "other-av",
    /// Agents continue from their last recorded state.
    Continuity => "jumps",
    /// Positions are in the frame of the states that they continue.
    Coordinates => "coordinates",
    /// Positions are box centres.
    RearAxle => "rear-axle",
    /// Lengths, speeds and times are in metres, m/s and steps of 0.1 s.
    Units => "units",
    /// Motion continues from the latest frame.
    Time => "time",
    /// Agents are in the order of the scenario.
    Order => "agent-order",
    /// Headings are radians counter-clockwise from the x axis, along the motion.
    Headings => "headings",
    /// Velocities are those of the positions.
    Velocities => "velocities",
    /// No agent moves further in 0.1 s than its class can.
    Teleports => "teleports",
    /// Moving agents do not stop dead.
    Freeze => "freeze",
    /// World coordinates in 32 bits resolve a centimetre.
    Float32 => "float32",
    /// Coordinates resolve a centimetre, in any other format.
    Resolution => "resolution",
    /// Agents that the log contains are present.
    Presence => "missing-agents",
    /// Every simulator has rollouts of every scenario.
    Coverage => "partial",
}

impl fmt::Display for RolloutCheck {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.allowance())
    }
}

impl FromStr for RolloutCheck {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::allowance).join(", ");
        let found = Self::ALL.into_iter().find(|check| check.allowance() == name);
        found.ok_or_else(|| format!("expected one of {}", known()))
    }
}
