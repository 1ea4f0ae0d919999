//! Microscopic traffic on a generated map.

pub mod fleet;
pub mod parked;
pub mod people;

use super::Layout;
use crate::rollout::Stream;
use crate::scene::{Agent, Frame, LightState};

/// What is recorded of traffic: 91 frames at 10 Hz.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recording {
    /// Everybody who was there at some frame, with 91 frames each.
    pub agents: Vec<(Agent, Vec<Frame>)>,
    /// Per signal plan of the layout, what it showed at each frame.
    pub lights: Vec<Vec<LightState>>,
    /// Indices into `agents` of the drivers who may be taken for the AV: there at every frame, not parked.
    pub drivers: Vec<usize>,
}

/// Lets traffic run on a map until it has settled, then records it.
///
/// `density` is the multiple of the entries' flows. The result depends on the arguments only.
pub fn record(_layout: &Layout, _density: f64, _rng: &mut Stream) -> Recording {
    Recording::default()
}
