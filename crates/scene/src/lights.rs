//! Traffic lights.

use reactsim_geometry::Vec2;

/// The state of a light for one lane (the states of the Waymo Open Motion Dataset).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum LightState {
    /// Observed, but with unknown colour.
    Unknown,
    /// Red arrow.
    ArrowStop,
    /// Yellow arrow.
    ArrowCaution,
    /// Green arrow.
    ArrowGo,
    /// Red.
    Stop,
    /// Yellow.
    Caution,
    /// Green.
    Go,
    /// Flashing red: stop, then go when clear.
    FlashingStop,
    /// Flashing yellow: proceed with caution.
    FlashingCaution,
}

impl LightState {
    /// All states, in the order of their codes 0 to 8 (as in the Waymo messages).
    pub const ALL: [Self; 9] = [
        Self::Unknown,
        Self::ArrowStop,
        Self::ArrowCaution,
        Self::ArrowGo,
        Self::Stop,
        Self::Caution,
        Self::Go,
        Self::FlashingStop,
        Self::FlashingCaution,
    ];

    /// Returns the name used in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Unknown => "unknown",
            Self::ArrowStop => "arrow_stop",
            Self::ArrowCaution => "arrow_caution",
            Self::ArrowGo => "arrow_go",
            Self::Stop => "stop",
            Self::Caution => "caution",
            Self::Go => "go",
            Self::FlashingStop => "flashing_stop",
            Self::FlashingCaution => "flashing_caution",
        }
    }

    /// Returns the state with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|s| s.name() == name)
    }

    /// Returns the code, 0 to 8.
    pub const fn code(self) -> u8 {
        self as u8
    }

    /// Returns whether the light is red or a red arrow (steady).
    pub const fn is_red(self) -> bool {
        matches!(self, Self::Stop | Self::ArrowStop)
    }

    /// Returns whether the light is yellow or a yellow arrow (steady).
    pub const fn is_yellow(self) -> bool {
        matches!(self, Self::Caution | Self::ArrowCaution)
    }
}

/// The position of a light that controls one lane. Its states are stored separately, split at the current
/// frame.
#[derive(Clone, Debug, PartialEq)]
pub struct TrafficLight {
    /// Index of the controlled lane in the map.
    pub lane: usize,
    /// Point at which to stop, metres.
    pub stop_point: Vec2,
}
