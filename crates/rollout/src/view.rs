//! What a simulator or an AV policy observes once agents have entered or left, after its horizon, or if it
//! was built for another length of history.

use std::sync::{Mutex, PoisonError};

use reactsim_scene::levels::RoadHeights;
use reactsim_scene::{Agent, AgentState, Frame, LightState, Scenario, Start};

use super::Observation;
use super::entering::Coming;
use super::track_heights::TrackHeights;

/// The changes for which an observer has got new views: agents, or objects of the static context, came or
/// went, or its horizon was over.
pub(crate) struct Changes {
    /// Number of agents that had entered or left.
    events: usize,
    /// Numbers of the objects of the static context.
    obstacles: Vec<usize>,
    /// Frame of the last change.
    frame: usize,
    pub(crate) count: usize,
}

impl Changes {
    /// Begins at the current frame.
    pub(crate) fn new(scenario: &Scenario) -> Self {
        let frame = scenario.start.current();
        Self { events: 0, obstacles: obstacles(scenario, frame).collect(), frame, count: 0 }
    }

    /// Returns whether there is a change since the last call, and counts it. `horizon`: number of steps after
    /// which the observer needs a new view in any case.
    pub(crate) fn has_changed(
        &mut self,
        scenario: &Scenario,
        coming: Option<&Coming>,
        frame: usize,
        horizon: Option<usize>,
    ) -> bool {
        let differs = |coming: &Coming| {
            coming.events != self.events || !obstacles(scenario, frame).eq(self.obstacles.iter().copied())
        };
        let is_over = horizon.is_some_and(|steps| frame - self.frame >= steps);
        let has_changed = is_over || coming.is_some_and(differs);
        if has_changed {
            (self.events, self.obstacles) =
                (coming.map_or(0, |coming| coming.events), obstacles(scenario, frame).collect());
            (self.frame, self.count) = (frame, self.count + 1);
        }
        has_changed
    }
}

/// Returns the numbers of the objects of the static context at a frame.
fn obstacles(scenario: &Scenario, frame: usize) -> impl Iterator<Item = usize> + '_ {
    scenario.context_at(frame).map(|(number, ..)| number)
}

/// The realised states as an observation of their own: the agents that are present, over the last frames.
pub(crate) struct View {
    start: Start,
    tracks: Vec<Vec<Frame>>,
    lights: Vec<Vec<Option<LightState>>>,
    /// Slot in the rollout of each agent.
    pub(crate) slots: Vec<usize>,
    /// Steps that were realised when the view was made.
    pub(crate) first_step: usize,
    /// Number of changes before it.
    changes: usize,
    heights: Mutex<RoadHeights>,
}

impl View {
    /// Makes the view at the latest realised frame. `history`: number of frames up to that one; frames from
    /// before the log are absent. `changes`: number of changes before it.
    pub(crate) fn new(
        scenario: &Scenario,
        coming: Option<&Coming>,
        tracks: &[Vec<Frame>],
        lights: &[Vec<Option<LightState>>],
        history: usize,
        changes: usize,
    ) -> Self {
        let (now, current) = (tracks[0].len() - 1, scenario.start.current());
        let has_left = |slot: usize| coming.is_some_and(|coming| coming.has_left(slot));
        let is_there = |slot: &usize| tracks[*slot][now].is_some() && !has_left(*slot);
        let slots: Vec<usize> = (0..tracks.len()).filter(is_there).collect();
        let recent = |track: &Vec<Frame>| last(track, history);
        let tracks_now: Vec<Vec<Frame>> = slots.iter().map(|slot| recent(&tracks[*slot])).collect();
        let light_history: Vec<_> = lights.iter().map(|states| last(states, history)).collect();
        let has_levels = scenario.start.has_levels();
        let entered = coming.map_or(&[][..], |coming| &coming.entered);
        let from_beginning = Mutex::<TrackHeights>::default();
        let heights = coming.map_or(&from_beginning, |coming| &coming.heights);
        let mut heights = heights.lock().unwrap_or_else(PoisonError::into_inner);
        let heights = |slot: &usize| last(heights.along(scenario, entered, *slot, &tracks[*slot]), history);
        let all: Vec<&Agent> = match coming {
            Some(coming) => coming.agents(scenario).collect(),
            None => scenario.start.agents.iter().collect(),
        };
        let mut start = Start {
            agents: slots.iter().map(|slot| all[*slot].clone()).collect(),
            history: tracks_now.clone(),
            obstacles: scenario.start.obstacles.clone(),
            obstacle_numbers: scenario.start.obstacle_numbers.clone(),
            map: scenario.start.map.clone(),
            heights: if has_levels { slots.iter().map(heights).collect() } else { Vec::new() },
            obstacle_heights: scenario.start.obstacle_heights.clone(),
            lights: scenario.start.lights.clone(),
            light_history: light_history.clone(),
        };
        if coming.is_some() && now > current {
            start.set_context(scenario, now);
        }
        Self {
            start,
            tracks: tracks_now,
            lights: light_history,
            slots,
            first_step: now - current,
            changes,
            heights: Mutex::default(),
        }
    }

    /// Adds the latest realised frame.
    pub(crate) fn push(&mut self, tracks: &[Vec<Frame>], lights: &[Vec<Option<LightState>>]) {
        for (own, slot) in self.tracks.iter_mut().zip(&self.slots) {
            own.push(tracks[*slot].last().copied().flatten());
        }
        for (own, states) in self.lights.iter_mut().zip(lights) {
            own.push(states.last().copied().flatten());
        }
    }

    pub(crate) fn seen(&self, av_next: Option<AgentState>) -> Observation<'_> {
        let seen = Observation::new(&self.start, &self.tracks, &self.lights, av_next);
        seen.continued(self.first_step, self.changes).with_heights(&self.heights)
    }

    /// Returns the index in the view of the agent with this slot in the rollout.
    pub(crate) fn index(&self, slot: usize) -> Option<usize> {
        // Slots ascend.
        self.slots.binary_search(&slot).ok()
    }

    pub(crate) fn start(&self) -> &Start {
        &self.start
    }
}

/// Returns the last values, preceded by absent ones if there are too few.
fn last<T: Copy>(values: &[Option<T>], count: usize) -> Vec<Option<T>> {
    let missing = count.saturating_sub(values.len());
    let recent = &values[values.len() - (count - missing)..];
    std::iter::repeat_n(None, missing).chain(recent.iter().copied()).collect()
}
