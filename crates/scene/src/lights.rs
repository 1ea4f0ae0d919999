//! Traffic lights.

use reactsim_geometry::Vec2;

use crate::named_enum;

named_enum! {
    name, from_name;

    /// The state of a light for one lane, in the order of the codes 0 to 8 of the Waymo Open Motion Dataset.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum LightState {
        /// Observed, but with unknown colour.
        Unknown = "unknown",
        /// Red arrow.
        ArrowStop = "arrow_stop",
        /// Yellow arrow.
        ArrowCaution = "arrow_caution",
        /// Green arrow.
        ArrowGo = "arrow_go",
        /// Red.
        Stop = "stop",
        /// Yellow.
        Caution = "caution",
        /// Green.
        Go = "go",
        /// Flashing red: stop, then go when clear.
        FlashingStop = "flashing_stop",
        /// Flashing yellow: proceed with caution.
        FlashingCaution = "flashing_caution",
    }
}

impl LightState {
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
