//! Scenarios: what was known at the current frame, and what the log holds after it.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use super::{
    Agent, AgentState, CURRENT, Certificate, DT, Frame, HISTORY, LightState, LoggedAgent, MapIndex, Road,
    RoadMap, TrafficLight,
};
use crate::geometry::{OrientedBox, Vec2};

/// The AV plus the 63 nearest agents (ReactSim-Bench, "Scenario Data").
pub const MAX_AGENTS: usize = 64;

/// The dominant source of a deviation from the log (ReactSim-Bench, "Deviation Taxonomy").
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Deviation {
    /// Same path, another speed profile.
    Longitudinal,
    /// Another lateral position.
    Lateral,
    /// Another direction.
    Directional,
}

impl Deviation {
    /// All categories.
    pub const ALL: [Self; 3] = [Self::Longitudinal, Self::Lateral, Self::Directional];

    /// The name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Longitudinal => "longitudinal",
            Self::Lateral => "lateral",
            Self::Directional => "directional",
        }
    }

    /// The category with this name.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|c| c.name() == name)
    }
}

/// A deviated AV: its category and its states at the steps 1 to 80, in the scenario frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviatedTrack {
    /// Dominant source of the deviation, where known.
    pub category: Option<Deviation>,
    /// 80 states.
    pub track: Vec<AgentState>,
    /// How every agent that the deviation disturbs can avoid it, where that is known.
    pub certificate: Option<Certificate>,
}

/// A recorded scene, split at the current frame. The split is the privacy boundary: simulators are given [`Start`] only.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name.
    pub id: String,
    /// Data set or format that it came from.
    pub source: String,
    /// The point of the world that is the origin of all coordinates here, metres.
    pub origin: Vec2,
    /// Time of each frame, seconds; empty where not recorded.
    pub timestamps: Vec<f64>,
    /// Agents that the data set asks to predict (ids).
    pub tracks_to_predict: Vec<String>,
    /// Agents that the data set calls interesting (ids).
    pub objects_of_interest: Vec<String>,
    /// What is known at the current frame.
    pub start: Start,
    /// What the log holds after the current frame.
    pub log_future: LogFuture,
    /// Recorded agents that are neither the AV nor among the chosen world agents: absent now, too far, or of kind `other`.
    pub unselected: Vec<LoggedAgent>,
    /// A deviated AV that came with the scenario.
    pub deviation: Option<DeviatedTrack>,
    /// What had to be left out of the file's data, by what it was: counts.
    pub repairs: BTreeMap<String, u32>,
}

/// What is known at the current frame: agents, their history, the map, the lights so far. Holds nothing of the future.
#[derive(Clone, Debug)]
pub struct Start {
    /// Slot 0 is the AV; then the world agents by distance to it.
    pub agents: Vec<Agent>,
    /// Per agent 11 frames; the last one is now and never absent.
    pub history: Vec<Vec<Frame>>,
    /// Boxes of the static context (kind `other`, present now).
    pub obstacles: Vec<OrientedBox>,
    /// The road map.
    pub map: RoadMap,
    /// The lights that stand in the map.
    pub lights: Vec<TrafficLight>,
    /// Per light its 11 observed states; `None` where not observed.
    pub light_history: Vec<Vec<Option<LightState>>>,
    pub(super) index: OnceLock<MapIndex>,
}

impl Start {
    /// The map with its spatial index, which is built at the first call.
    pub fn road(&self) -> Road<'_> {
        Road::new(&self.map, self.index.get_or_init(|| MapIndex::new(&self.map)))
    }

    /// The state of an agent at the current frame.
    pub fn now(&self, agent: usize) -> AgentState {
        self.history[agent][CURRENT].expect("agents are chosen by being present now")
    }
}

/// The log after the current frame. Only oracles, metrics and logged AVs may look at it.
#[derive(Clone, Debug, PartialEq)]
pub struct LogFuture {
    /// Per agent (same order as in [`Start`]) 80 frames.
    pub tracks: Vec<Vec<Frame>>,
    /// Per light 80 observed states.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl Scenario {
    /// The whole logged track of an agent: 91 frames.
    pub fn logged(&self, agent: usize) -> Vec<Frame> {
        self.start.history[agent].iter().chain(&self.log_future.tracks[agent]).copied().collect()
    }

    /// The logged state of an agent at a frame; beyond the last one it is absent.
    pub fn logged_at(&self, agent: usize, frame: usize) -> Frame {
        match frame.checked_sub(HISTORY) {
            None => self.start.history[agent][frame],
            Some(k) => self.log_future.tracks[agent].get(k).copied().flatten(),
        }
    }

    /// The logged velocity of an agent at a frame, m/s: the recorded one, else the backward difference of its positions, else the forward
    /// difference (the rule of the metrics). `None` where it is absent or alone.
    pub fn logged_velocity(&self, agent: usize, frame: usize) -> Option<Vec2> {
        let at = |f: usize| self.logged_at(agent, f);
        let here = at(frame)?;
        let step = |from: AgentState, to: AgentState| (to.position() - from.position()) / DT;
        let before = || frame.checked_sub(1).and_then(at).map(|b| step(b, here));
        let after = || at(frame + 1).map(|a| step(here, a));
        here.velocity().or_else(before).or_else(after)
    }

    /// The observed states of a light over all 91 frames.
    pub fn light_states(&self, light: usize) -> Vec<Option<LightState>> {
        self.start.light_history[light].iter().chain(&self.log_future.lights[light]).copied().collect()
    }
}
