//! The roads of a scenario as reactive agents use them.

use std::sync::Arc;

use reactsim_rollout::Observation;
use reactsim_scene::{Lane, LaneClass, LightState as SceneLight, Start, StopKind};

use crate::PlanningError;
use crate::idm_agents::{AgentRoads, SignalLine};
use crate::map::{DrivableArea, Roadblock};
use crate::planner::{Light, LightState};

use super::lights::planner_light;
use super::map::made_of;
use super::roadblocks::Roadblocks;

/// The roads of a scenario as reactive agents use them, and its lights on them.
#[derive(Clone, Debug)]
pub struct SceneRoads {
    /// The lanes, without those for bicycles only, and the stop lines of lights.
    pub roads: Arc<AgentRoads>,
    /// Lane of each light of the scenario; `None` if it is left out.
    lanes_of_lights: Vec<Option<usize>>,
}

impl SceneRoads {
    /// Reads the roads of a scenario. Lanes with a light have a signal.
    ///
    /// # Errors
    /// [`PlanningError`] if a polygon of the map has no area.
    pub fn new(start: &Start) -> Result<Self, PlanningError> {
        let map = &start.map;
        let kept: Vec<usize> =
            (0..map.lanes.len()).filter(|&lane| map.lanes[lane].class != LaneClass::Bike).collect();
        let index = |lane: &usize| kept.binary_search(lane).ok();
        let lane = |&origin: &usize| {
            let lane = &map.lanes[origin];
            Lane {
                predecessors: lane.predecessors.iter().filter_map(index).collect(),
                successors: lane.successors.iter().filter_map(index).collect(),
                ..lane.clone()
            }
        };
        let lanes: Vec<Lane> = kept.iter().map(lane).collect();
        // Agents know lanes only: one roadblock stands for all.
        let list = vec![Roadblock { id: "all".to_owned(), area: None }];
        let roadblocks = Roadblocks { list, of_lane: vec![0; lanes.len()] };
        let made = made_of(map, &lanes, roadblocks, DrivableArea::Unknown)?;
        let lanes_of_lights: Vec<Option<usize>> =
            start.lights.iter().map(|light| index(&light.lane)).collect();
        let signalled: Vec<usize> = lanes_of_lights.iter().copied().flatten().collect();
        let of_lights = map.stop_lines.iter().filter(|line| line.kind == StopKind::Light).enumerate();
        let lines = of_lights.filter_map(|(i, line)| {
            let connectors = vec![index(&line.lane)?];
            Some(SignalLine { id: i.to_string(), outline: line.ends.to_vec(), connectors })
        });
        let lines = lines.collect();
        Ok(Self { roads: Arc::new(AgentRoads::new(made, &signalled, lines)), lanes_of_lights })
    }

    /// Returns the present states of the lights. A flashing light is green: it does not tell to wait until it
    /// changes.
    pub fn lights_now(&self, seen: &Observation<'_>) -> Vec<Light> {
        let states = self.lanes_of_lights.iter().zip(seen.lights_now());
        let light = |(lane, state): (&Option<usize>, Option<SceneLight>)| {
            let state = match state {
                Some(SceneLight::FlashingStop | SceneLight::FlashingCaution) => LightState::Green,
                other => planner_light(other),
            };
            Some(Light { lane: (*lane)?, state })
        };
        states.filter_map(light).collect()
    }
}
