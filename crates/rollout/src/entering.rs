//! Agents of the log that enter a rollout after its beginning, and agents that leave it.

mod road_ends;

use std::fmt;
use std::str::FromStr;
use std::sync::{Mutex, PoisonError};

use reactsim_geometry::OrientedBox;
use reactsim_scene::{
    Agent, AgentKind, AgentState, Frame, LoggedAgent, OBSERVED_DISTANCE, Scenario, named_enum,
};

use super::track_heights::TrackHeights;
use road_ends::RoadEnds;

named_enum! {
    name, from_name;

    /// Whether agents of the log that appear after the current frame enter a rollout.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
    pub enum Entering {
        /// No agent enters or leaves, and obstacles stay: the protocol of the benchmark.
        #[default]
        Off = "off",
        /// An agent that the log shows later enters at its first pose, and is moved by the simulator from
        /// then on.
        Log = "log",
    }
}

impl fmt::Display for Entering {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Entering {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        Self::from_name(name).ok_or_else(|| "expected off or log".to_owned())
    }
}

/// Largest number of agents that are present at one time, the AV included, if agents enter.
pub const MAX_PRESENT: usize = 256;

/// An agent that entered a rollout.
#[derive(Clone, Debug, PartialEq)]
pub struct Entered {
    /// Index in [`Scenario::unselected`].
    pub logged: usize,
    /// Frame of its first state.
    pub frame: usize,
    /// Number of frames that it waited because another agent stood in its place, or too many were present.
    pub waited: usize,
}

impl Entered {
    /// Returns the height at which the log first shows the agent, metres; NaN if unknown.
    pub(crate) fn first_height(&self, scenario: &Scenario) -> f64 {
        first_height(&scenario.unselected[self.logged], self.frame - self.waited)
    }
}

fn first_height(logged: &LoggedAgent, first: usize) -> f64 {
    logged.heights.get(first).copied().flatten().unwrap_or(f64::NAN)
}

/// The agents of a rollout that come and go.
pub(crate) struct Coming {
    /// Agents that have not entered, by the frame of their first state.
    waiting: Vec<Waiting>,
    pub(crate) entered: Vec<Entered>,
    /// Last logged frame of each agent of the rollout, and its distance to the logged AV there, if the log
    /// loses it outside of the observed area.
    lost: Vec<Option<(usize, f64)>>,
    road_ends: RoadEnds,
    /// Whether each agent of the rollout has left.
    left: Vec<bool>,
    /// Number of agents that left where the log loses them.
    pub(crate) left_as_logged: usize,
    /// Number of agents that left past the end of a road.
    pub(crate) past_road_end: usize,
    /// Heights of all agents.
    pub(crate) heights: Mutex<TrackHeights>,
    /// Number of agents that entered or left so far.
    pub(crate) events: usize,
}

/// An agent that has not entered.
struct Waiting {
    logged: usize,
    first: usize,
    /// Whether too many agents were present when it was last to enter.
    is_over_limit: bool,
}

impl Coming {
    /// Finds the agents of the log that appear after the current frame: vehicles, pedestrians and cyclists
    /// with an extent.
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let current = scenario.start.current();
        let enters = |(logged, LoggedAgent { agent, track, .. }): (usize, &LoggedAgent)| {
            let is_new = agent.kind != AgentKind::Other && agent.has_extent() && track[current].is_none();
            let first = (current + 1..track.len()).find(|f| track[*f].is_some())?;
            is_new.then_some(Waiting { logged, first, is_over_limit: false })
        };
        let mut waiting: Vec<Waiting> = scenario.unselected.iter().enumerate().filter_map(enters).collect();
        waiting.sort_by_key(|agent| agent.first);
        let agents = scenario.start.agents.len();
        let lost = (0..agents).map(|slot| lost(scenario, |frame| scenario.logged_at(slot, frame))).collect();
        let left = vec![false; agents];
        Self {
            waiting,
            entered: Vec::new(),
            lost,
            road_ends: RoadEnds::new(&scenario.start),
            left,
            left_as_logged: 0,
            past_road_end: 0,
            heights: Mutex::default(),
            events: 0,
        }
    }

    /// Returns the number of agents that still wait at a frame, although the log has shown them: for their
    /// place, or because too many are present.
    pub(crate) fn kept_out(&self, frame: usize, is_over_limit: bool) -> usize {
        let due = self.waiting.iter().take_while(|agent| agent.first <= frame);
        due.filter(|agent| agent.is_over_limit == is_over_limit).count()
    }

    /// Lets agents enter at the latest realised frame, those nearest to the AV first, and adds their tracks.
    /// `waits`: whether an agent waits while another stands in its place; those of an oracle would jump when
    /// it replays their log.
    pub(crate) fn admit(&mut self, scenario: &Scenario, tracks: &mut Vec<Vec<Frame>>, waits: bool) {
        let frame = tracks[0].len() - 1;
        if self.waiting.first().is_none_or(|next| next.first > frame) {
            return;
        }
        let Some(av) = tracks[0][frame] else { return };
        let place = |agent: &Waiting| scenario.unselected[agent.logged].track[agent.first];
        let mut due: Vec<(f64, usize, AgentState)> = Vec::new();
        for (i, agent) in self.waiting.iter().enumerate().take_while(|(_, agent)| agent.first <= frame) {
            let Some(state) = place(agent) else { continue };
            due.push(((state.position() - av.position()).norm(), i, state));
        }
        due.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let agents: Vec<&Agent> = self.agents(scenario).collect();
        let heights = self.heights.get_mut().unwrap_or_else(PoisonError::into_inner);
        let road = scenario.start.road();
        let mut present: Vec<(OrientedBox, f64)> = Vec::new();
        for (slot, (track, agent)) in tracks.iter().zip(agents).enumerate() {
            let Some(state) = track[frame] else { continue };
            let mut known = || heights.along(scenario, &self.entered, slot, track).last().copied().flatten();
            let height = if scenario.start.has_levels() { known() } else { None };
            present.push((state.footprint(agent), height.unwrap_or(f64::NAN)));
        }
        let mut admitted = Vec::new();
        for (_, i, state) in due {
            let Waiting { logged, first, .. } = self.waiting[i];
            let LoggedAgent { agent, track, .. } = &scenario.unselected[logged];
            let own = state.footprint(agent);
            let recorded = first_height(&scenario.unselected[logged], first);
            let height = road.ground_height(state.position(), recorded);
            let is_over_limit = present.len() >= MAX_PRESENT;
            let is_in_place = |(other, z): &(OrientedBox, f64)| {
                other.signed_distance(&own) <= 0.0 && !road.is_apart((other.center, *z), (own.center, height))
            };
            if waits && (is_over_limit || present.iter().any(is_in_place)) {
                self.waiting[i].is_over_limit = is_over_limit;
                continue;
            }
            present.push((own, height));
            let mut states: Vec<Frame> = track[..=scenario.start.current()].to_vec();
            states.resize(frame, None);
            states.push(Some(state));
            tracks.push(states);
            admitted.push(i);
            self.entered.push(Entered { logged, frame, waited: frame - first });
            self.lost.push(lost(scenario, |f| track.get(f).copied().flatten()));
            self.left.push(false);
        }
        let mut index = 0..;
        self.waiting.retain(|_| index.next().is_some_and(|i: usize| !admitted.contains(&i)));
        self.events += admitted.len();
    }

    pub(crate) fn has_left(&self, slot: usize) -> bool {
        self.left[slot]
    }

    /// Returns the logged state at a frame of the agent that entered as this one. The log of an agent that
    /// waited is late by as much.
    pub(crate) fn logged(&self, scenario: &Scenario, entered: usize, frame: usize) -> Frame {
        let Entered { logged, waited, .. } = self.entered[entered];
        scenario.unselected[logged].track.get(frame - waited).copied().flatten()
    }

    /// Returns the agents of the rollout, in the order of their slots.
    pub(crate) fn agents<'s>(&self, scenario: &'s Scenario) -> impl Iterator<Item = &'s Agent> {
        let entered: Vec<usize> = self.entered.iter().map(|entered| entered.logged).collect();
        let entered = entered.into_iter().map(|logged| &scenario.unselected[logged].agent);
        scenario.start.agents.iter().chain(entered)
    }

    /// Marks the agents that leave at the latest realised frame. They are outside of the observed area, and
    /// either reach the end of a road, or are as far from the AV as when the log lost them.
    pub(crate) fn let_go(&mut self, scenario: &Scenario, tracks: &[Vec<Frame>]) {
        let frame = tracks[0].len() - 1;
        let Some(av) = tracks[0][frame] else { return };
        let agents: Vec<&Agent> = self.agents(scenario).collect();
        for (slot, agent) in agents.into_iter().enumerate().skip(1) {
            let Some(state) = tracks[slot][frame].filter(|_| !self.left[slot]) else { continue };
            let distance = (state.position() - av.position()).norm();
            let is_lost = self.lost[slot].is_some_and(|(last, far)| frame >= last && distance >= far);
            let is_past = distance >= OBSERVED_DISTANCE && self.road_ends.reaches(agent, state);
            self.left[slot] = is_lost || is_past;
            self.left_as_logged += usize::from(is_lost);
            self.past_road_end += usize::from(is_past && !is_lost);
            self.events += usize::from(self.left[slot]);
        }
    }
}

/// Returns the last frame at which the log shows an agent, and its distance to the logged AV there, metres;
/// `None` if the log shows it to its end, never after the current frame, or loses it near the AV.
fn lost(scenario: &Scenario, logged: impl Fn(usize) -> Frame) -> Option<(usize, f64)> {
    let length = scenario.length();
    let last = (0..length.frames()).rev().find(|frame| logged(*frame).is_some())?;
    let (av, state) = (scenario.logged_at(0, last)?, logged(last)?);
    let distance = (state.position() - av.position()).norm();
    (last + 1 < length.frames() && distance >= OBSERVED_DISTANCE).then_some((last, distance))
}

#[cfg(test)]
mod tests;
