//! The lights of a case.

use reactsim_geometry::Vec2;
use reactsim_scene::{LightState, Scenario};

/// A light that controls one lane, with its states split at the current frame.
#[derive(Clone, Copy, Debug)]
pub struct ObservedLight<'a> {
    /// Index of the controlled lane in the map.
    pub lane: usize,
    /// Point at which to stop, metres.
    pub stop_point: Vec2,
    /// States up to and including the current frame; `None` if not observed.
    pub history: &'a [Option<LightState>],
    /// States after the current frame.
    pub future: &'a [Option<LightState>],
}

impl<'a> ObservedLight<'a> {
    pub(super) fn all(scenario: &'a Scenario) -> Vec<Self> {
        let states = scenario.start.light_history.iter().zip(&scenario.log_future.lights);
        let light =
            |(light, (history, future)): (&reactsim_scene::TrafficLight, (&'a Vec<_>, &'a Vec<_>))| Self {
                lane: light.lane,
                stop_point: light.stop_point,
                history,
                future,
            };
        scenario.start.lights.iter().zip(states).map(light).collect()
    }

    /// Returns the colour at a frame; `None` if it is not known.
    pub fn at(&self, frame: usize) -> Option<LightState> {
        let state = match frame.checked_sub(self.history.len()) {
            None => self.history[frame],
            Some(k) => self.future.get(k).copied().flatten(),
        };
        state.filter(|s| *s != LightState::Unknown)
    }
}
