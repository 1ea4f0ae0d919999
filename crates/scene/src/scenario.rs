//! Scenarios: the information known at the current frame, and the log after it.

use std::collections::BTreeMap;
use std::sync::OnceLock;

use reactsim_geometry::{OrientedBox, Vec2};

use super::{
    Agent, AgentState, Certificate, DT, Frame, Length, LightState, LoggedAgent, Notes, Road, SharedMap,
    TrafficLight, named_enum,
};

/// Maximum number of agents: the AV plus the 63 nearest others (ReactSim-Bench, "Scenario Data").
pub const MAX_AGENTS: usize = 64;
/// Distance in metres from the AV from which an agent is outside of the observed area. An agent that the log
/// loses nearer was hidden.
pub const OBSERVED_DISTANCE: f64 = 50.0;

named_enum! {
    name, from_name;

    /// The dominant source of a deviation from the log (ReactSim-Bench, "Deviation Taxonomy").
    #[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
    pub enum Deviation {
        /// Same path, another speed profile.
        Longitudinal = "longitudinal",
        /// Another lateral position.
        Lateral = "lateral",
        /// Another direction.
        Directional = "directional",
    }
}

/// A deviated AV: its category and its states at the steps after the current frame, in the scenario frame.
#[derive(Clone, Debug, PartialEq)]
pub struct DeviatedTrack {
    /// Dominant source of the deviation, if known.
    pub category: Option<Deviation>,
    /// One state per step.
    pub track: Vec<AgentState>,
    /// Responses with which every agent that the deviation affects can avoid it, if known.
    pub certificate: Option<Certificate>,
}

/// A recorded scene, split at the current frame. The split is the information boundary: simulators get
/// [`Start`] only.
#[derive(Clone, Debug)]
pub struct Scenario {
    /// Name.
    pub id: String,
    /// Data set or format of origin.
    pub source: String,
    /// World point that is the origin of all coordinates here, metres.
    pub origin: Vec2,
    /// Time of each frame, seconds; empty if not recorded.
    pub timestamps: Vec<f64>,
    /// Ids of the agents that the data set marks for prediction.
    pub tracks_to_predict: Vec<String>,
    /// Ids of the agents that the data set marks as interesting.
    pub objects_of_interest: Vec<String>,
    /// Information known at the current frame.
    pub start: Start,
    /// The log after the current frame.
    pub log_future: LogFuture,
    /// Recorded agents other than the AV and the selected world agents: absent now, too far away, or of kind
    /// `other`.
    pub unselected: Vec<LoggedAgent>,
    /// Whether the static context is that of each frame of the log, not that of the current frame.
    pub context_changes: bool,
    /// A deviated AV that came with the scenario.
    pub deviation: Option<DeviatedTrack>,
    /// Number of items that had to be dropped from the file's data, by description.
    pub repairs: BTreeMap<String, u32>,
    pub(super) notes: OnceLock<Notes>,
}

/// The information known at the current frame: agents, their history, the map, the lights so far. It contains
/// nothing of the future.
#[derive(Clone, Debug)]
pub struct Start {
    /// The AV in slot 0, then the world agents by distance to it.
    pub agents: Vec<Agent>,
    /// Frames per agent, as many for each; the last one is now and never absent.
    pub history: Vec<Vec<Frame>>,
    /// Boxes of the static context (kind `other`, present now).
    pub obstacles: Vec<OrientedBox>,
    /// Number of each obstacle, which it keeps when others come or go; empty if each has that of its place.
    pub obstacle_numbers: Vec<usize>,
    /// The road map.
    pub map: SharedMap,
    /// Height of each agent at each frame, metres, if known; empty if the scenario has one level.
    pub heights: Vec<Vec<Option<f64>>>,
    /// Height of each obstacle, metres, if known; empty if the scenario has one level.
    pub obstacle_heights: Vec<Option<f64>>,
    /// The lights of the map.
    pub lights: Vec<TrafficLight>,
    /// Observed states per light, one per frame; `None` if not observed.
    pub light_history: Vec<Vec<Option<LightState>>>,
}

impl Start {
    /// Returns the map with its spatial index, which is built at the first call.
    pub fn road(&self) -> Road<'_> {
        self.map.road()
    }

    /// Returns the state of an agent at the current frame.
    pub fn now(&self, agent: usize) -> AgentState {
        self.history[agent][self.current()].expect("selected agents are present now")
    }

    /// Returns the index of the current frame, the last one of the history.
    #[inline]
    pub fn current(&self) -> usize {
        self.history[0].len() - 1
    }
}

/// The log after the current frame. Only oracles, metrics and logged AVs may look at it.
#[derive(Clone, Debug, PartialEq)]
pub struct LogFuture {
    /// Frames per agent, in the order of [`Start`].
    pub tracks: Vec<Vec<Frame>>,
    /// Heights per agent, metres, if known; empty if the scenario has one level.
    pub heights: Vec<Vec<Option<f64>>>,
    /// Observed states per light.
    pub lights: Vec<Vec<Option<LightState>>>,
}

impl Scenario {
    /// Returns the number of frames up to and after the current one.
    #[inline]
    pub fn length(&self) -> Length {
        Length { history: self.start.history[0].len(), future: self.log_future.tracks[0].len() }
    }

    /// Returns the scenario without anything after the current frame: logged futures, agents that appear
    /// later, deviated AV, and the marks of agents, which data sets choose by their later motion.
    pub fn without_future(mut self) -> Self {
        self.log_future.tracks.iter_mut().for_each(|track| track.fill(None));
        self.log_future.heights.iter_mut().for_each(|heights| heights.fill(None));
        self.log_future.lights.iter_mut().for_each(|states| states.fill(None));
        let history = self.length().history;
        for agent in &mut self.unselected {
            agent.track[history..].fill(None);
            agent.heights.iter_mut().skip(history).for_each(|height| *height = None);
        }
        self.unselected.retain(|agent| agent.track.iter().any(Option::is_some));
        self.deviation = None;
        self.tracks_to_predict.clear();
        self.objects_of_interest.clear();
        self
    }

    /// Returns the whole logged track of an agent.
    pub fn logged(&self, agent: usize) -> Vec<Frame> {
        self.start.history[agent].iter().chain(&self.log_future.tracks[agent]).copied().collect()
    }

    /// Returns the logged state of an agent at a frame; absent beyond the last frame.
    pub fn logged_at(&self, agent: usize, frame: usize) -> Frame {
        match frame.checked_sub(self.start.history[agent].len()) {
            None => self.start.history[agent][frame],
            Some(k) => self.log_future.tracks[agent].get(k).copied().flatten(),
        }
    }

    /// Returns the logged velocity of an agent at a frame, m/s: the recorded velocity, else the backward
    /// difference of its positions, else the forward difference (the rule of the metrics). `None` if the
    /// agent is absent at this frame, or present at neither neighbouring frame.
    pub fn logged_velocity(&self, agent: usize, frame: usize) -> Option<Vec2> {
        let at = |f: usize| self.logged_at(agent, f);
        let here = at(frame)?;
        let step = |from: AgentState, to: AgentState| (to.position() - from.position()) / DT;
        let before = || frame.checked_sub(1).and_then(at).map(|b| step(b, here));
        let after = || at(frame + 1).map(|a| step(here, a));
        here.velocity().or_else(before).or_else(after)
    }

    /// Returns the observed states of a light over all frames.
    pub fn light_states(&self, light: usize) -> Vec<Option<LightState>> {
        self.start.light_history[light].iter().chain(&self.log_future.lights[light]).copied().collect()
    }
}
