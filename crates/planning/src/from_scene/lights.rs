//! The traffic lights of a scenario as planners observe them.

use std::iter::repeat;
use std::ops::Range;

use reactsim_rollout::Observation;
use reactsim_scene::{LightState as SceneLight, Start};

use crate::planner::{Light, LightState};

use super::planning_lanes;

/// The lanes of the planning map that each light of a scenario controls: none if the map leaves its lane out,
/// all parts of a lane that is cut.
#[derive(Clone, Debug)]
pub(crate) struct LightLanes(Vec<Range<usize>>);

impl LightLanes {
    pub(crate) fn new(start: &Start) -> Self {
        let lanes = planning_lanes(&start.map);
        let parts = |lane: usize| {
            lanes.partition_point(|&origin| origin < lane)..lanes.partition_point(|&origin| origin <= lane)
        };
        Self(start.lights.iter().map(|light| parts(light.lane)).collect())
    }

    /// Returns the present states, in the order of the scenario.
    pub(crate) fn now(&self, seen: &Observation<'_>) -> Vec<Light> {
        let states = seen.lights_now();
        let lanes = self.0.iter().zip(states).flat_map(|(lanes, state)| lanes.clone().zip(repeat(state)));
        lanes.map(|(lane, state)| Light { lane, state: planner_light(state) }).collect()
    }
}

/// Returns the state for planners. Arrows count as full lights, because a light controls one lane only.
///
/// A flashing red light is a stop sign: drivers stop and then go when it is clear. Planners have no such rule
/// and would wait in front of a red light forever, so it is unknown to them.
pub(super) fn planner_light(state: Option<SceneLight>) -> LightState {
    match state {
        Some(SceneLight::Stop | SceneLight::ArrowStop) => LightState::Red,
        Some(SceneLight::Caution | SceneLight::ArrowCaution | SceneLight::FlashingCaution) => {
            LightState::Yellow
        }
        Some(SceneLight::Go | SceneLight::ArrowGo) => LightState::Green,
        Some(SceneLight::Unknown | SceneLight::FlashingStop) | None => LightState::Unknown,
    }
}
