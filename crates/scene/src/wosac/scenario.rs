//! Conversion of the crate's scenarios, so that rollouts on scenarios of any format can be scored.

use std::collections::{BTreeMap, BTreeSet};

use reactsim_geometry::Vec2;

use super::{LaneSignal, SurfaceLane, WosacLog, WosacTrack};
use crate::{Frame, LaneClass, Length, Scenario, SceneError};

impl WosacLog {
    /// Converts a scenario. The result lacks what a [`Scenario`] lacks, so that scores differ from those of
    /// the recording itself: objects other than its agents (at most 64) are absent, z and heights are 0,
    /// states at invalid frames are 0, a light has one stop point, and repeated points of lanes are dropped.
    /// Agents keep ids that are whole numbers; if there are others, ids are the indices in
    /// [`Start::agents`](crate::Start).
    ///
    /// # Errors
    /// If the scenario has another length than those of the challenge, which its metrics require.
    pub fn of_scenario(scenario: &Scenario) -> Result<Self, SceneError> {
        let (length, expected) = (scenario.length(), Length::BENCHMARK);
        if length != expected {
            return Err(SceneError {
                scenario: scenario.id.clone(),
                field: "the length".into(),
                value: length.to_string(),
                expected: format!("{expected}: the realism metrics of Sim Agents have no other length"),
            });
        }
        let start = &scenario.start;
        let ids = object_ids(scenario);
        let track = |(i, agent): (usize, &crate::Agent)| {
            let frames = scenario.logged(i);
            let column = |value: fn(&crate::AgentState) -> f64, offset: f64| {
                let stored =
                    |frame: &Frame| frame.as_ref().map_or(0.0, |state| (value(state) + offset) as f32);
                frames.iter().map(stored).collect::<Vec<f32>>()
            };
            WosacTrack {
                id: ids[i],
                kind: agent.kind,
                length: agent.length as f32,
                width: agent.width as f32,
                height: 0.0,
                x: column(|state| state.x, scenario.origin.x),
                y: column(|state| state.y, scenario.origin.y),
                z: vec![0.0; length.frames()],
                heading: column(|state| state.heading, 0.0),
                valid: frames.iter().map(Frame::is_some).collect(),
            }
        };
        let world =
            |point: Vec2| [point.x + scenario.origin.x, point.y + scenario.origin.y].map(|v| v as f32);
        let edge = |points: &[Vec2]| points.iter().map(|&p| [world(p)[0], world(p)[1], 0.0]).collect();
        let surface = start.map.lanes.iter().enumerate();
        let surface = surface.filter(|(_, lane)| lane.class == LaneClass::SurfaceStreet);
        let signals = |frame: usize| {
            let observed = |(i, light): (usize, &crate::TrafficLight)| {
                let state = scenario.light_states(i)[frame]?;
                Some(LaneSignal {
                    lane: light.lane as i64,
                    state: i32::from(state.code()),
                    stop_point: world(light.stop_point),
                })
            };
            start.lights.iter().enumerate().filter_map(observed).collect()
        };
        let is_marked = |id: &String| scenario.tracks_to_predict.contains(id);
        let signals = |frames: usize| {
            if start.lights.is_empty() { Vec::new() } else { (0..frames).map(signals).collect() }
        };
        Ok(Self {
            scenario_id: scenario.id.clone(),
            tracks: start.agents.iter().enumerate().map(track).collect(),
            av: 0,
            tracks_to_predict: (0..start.agents.len()).filter(|&i| is_marked(&start.agents[i].id)).collect(),
            road_edges: start.map.road_edges.iter().map(|line| edge(&line.points)).collect(),
            surface_lanes: surface
                .map(|(i, lane)| SurfaceLane {
                    id: i as i64,
                    points: lane.baseline.points().iter().map(|&p| world(p)).collect(),
                })
                .collect(),
            signals: signals(length.frames()),
        })
    }
}

/// The ids of agents as those of objects.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ObjectIds {
    /// Ids are whole numbers.
    Own,
    /// Ids by those of the agents.
    ByAgent(BTreeMap<String, i32>),
}

impl ObjectIds {
    /// Returns the ids of the agents of a scenario, as in [`WosacLog::of_scenario`].
    pub fn of(scenario: &Scenario) -> Self {
        let names = scenario.start.agents.iter().map(|agent| agent.id.clone());
        Self::ByAgent(names.zip(object_ids(scenario)).collect())
    }

    /// Returns the id of the object with this agent id; `None` if there is none.
    pub fn get(&self, agent: &str) -> Option<i32> {
        match self {
            Self::Own => agent.parse().ok(),
            Self::ByAgent(ids) => ids.get(agent).copied(),
        }
    }
}

/// Returns the ids of the agents as numbers: their own if all are different whole numbers, else their
/// indices.
fn object_ids(scenario: &Scenario) -> Vec<i32> {
    let agents = &scenario.start.agents;
    let own: Option<Vec<i32>> = agents.iter().map(|agent| agent.id.parse().ok()).collect();
    own.filter(|ids| ids.iter().collect::<BTreeSet<_>>().len() == agents.len())
        .unwrap_or_else(|| (0..agents.len() as i32).collect())
}
