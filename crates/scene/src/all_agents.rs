//! Scenarios with agents that the benchmark does not select.

use std::sync::OnceLock;

use reactsim_geometry::OrientedBox;

use super::assemble::WITHOUT_EXTENT;
use super::{AgentKind, AgentState, Length, LoggedAgent, Scenario, Start};

impl Scenario {
    /// Selects all agents that are present at the current frame, of all kinds, sizes and any number, as the
    /// Sim Agents challenge requires; without this the benchmark selects the 63 nearest vehicles, pedestrians
    /// and cyclists with an extent. The agents that are added follow those selected before, by distance to
    /// the AV. Obstacles become agents of kind `other`. Agents with a box of size zero are simulated, but no
    /// metric of the benchmark judges them.
    pub fn with_all_agents(mut self) -> Self {
        let (av, length) = (self.start.now(0).position(), self.length());
        let current = length.current();
        let is_here = |logged: &LoggedAgent| logged.track[current].is_some();
        let (mut added, rest): (Vec<LoggedAgent>, Vec<LoggedAgent>) =
            std::mem::take(&mut self.unselected).into_iter().partition(is_here);
        let distance = |logged: &LoggedAgent| {
            logged.track[current].map_or(f64::INFINITY, |state| (state.position() - av).norm())
        };
        // Equally distant agents stay in the order of the file.
        added.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        added.into_iter().for_each(|logged| self.add_agent(logged, length));
        self.start.obstacles.clear();
        self.start.obstacle_heights.clear();
        self.repairs.remove(WITHOUT_EXTENT);
        Self { unselected: rest, notes: OnceLock::new(), ..self }
    }

    /// Returns the scenario as it is in a rollout that agents of [`Self::unselected`] enter, for judging and
    /// drawing: they follow the agents of the beginning in this order, and are absent at the current frame,
    /// where [`Start::now`] has no state of them. Of the other agents it has the static context, which is
    /// that of each frame.
    pub fn with_entered(&self, entered: &[usize]) -> Self {
        let length = self.length();
        let is_context = |logged: &&LoggedAgent| logged.agent.kind == AgentKind::Other;
        let mut scenario = Self {
            id: self.id.clone(),
            source: self.source.clone(),
            origin: self.origin,
            timestamps: self.timestamps.clone(),
            tracks_to_predict: self.tracks_to_predict.clone(),
            objects_of_interest: self.objects_of_interest.clone(),
            start: self.start.clone(),
            log_future: self.log_future.clone(),
            unselected: self.unselected.iter().filter(is_context).cloned().collect(),
            context_changes: true,
            deviation: self.deviation.clone(),
            repairs: self.repairs.clone(),
            // The notes are about the agents of the beginning.
            notes: OnceLock::from(self.notes().clone()),
        };
        let has_levels = self.start.has_levels();
        for logged in entered.iter().map(|logged| &self.unselected[*logged]) {
            scenario.add_agent(logged.clone(), length);
            if has_levels && let Some(heights) = scenario.start.heights.last_mut() {
                // Its height at its first frame is the one from which it is followed.
                let first = (length.history..logged.track.len()).find(|frame| logged.track[*frame].is_some());
                heights[length.current()] = first.and_then(|frame| *logged.heights.get(frame)?);
            }
        }
        scenario
    }

    /// Appends a logged agent: its frames up to the current one to the start, the later ones to the log.
    pub(super) fn add_agent(&mut self, logged: LoggedAgent, length: Length) {
        let LoggedAgent { agent, mut track, mut heights } = logged;
        self.log_future.tracks.push(track.split_off(length.history));
        self.start.history.push(track);
        self.start.agents.push(agent);
        if self.start.has_levels() {
            heights.resize(length.frames(), None);
            self.log_future.heights.push(heights.split_off(length.history));
            self.start.heights.push(heights);
        }
    }

    /// Returns the boxes of the static context at a frame: those of the start, or of the frame if it changes.
    pub fn obstacles_at(&self, frame: usize) -> Vec<OrientedBox> {
        if !self.context_changes {
            return self.start.obstacles.clone();
        }
        self.context_at(frame).map(|(_, logged, state)| state.footprint(&logged.agent)).collect()
    }

    /// Returns the static context at a frame of the log: objects of kind `other` with an extent that are
    /// present. Each has a number, which for those of the current frame is their place among the obstacles of
    /// the start.
    pub fn context_at(&self, frame: usize) -> impl Iterator<Item = (usize, &LoggedAgent, AgentState)> {
        let (current, mut now, mut others) = (self.start.current(), 0.., self.start.obstacles.len()..);
        let context = self.unselected.iter();
        let context = context.filter(|a| a.agent.kind == AgentKind::Other && a.agent.has_extent());
        context.filter_map(move |logged| {
            let is_now = logged.track[current].is_some();
            let number = if is_now { now.next() } else { others.next() }?;
            Some((number, logged, logged.track.get(frame).copied().flatten()?))
        })
    }
}

impl Start {
    /// Replaces the obstacles by the static context at a frame of the log.
    pub fn set_context(&mut self, scenario: &Scenario, frame: usize) {
        let has_levels = self.has_levels();
        self.obstacles.clear();
        self.obstacle_numbers.clear();
        self.obstacle_heights.clear();
        for (number, logged, state) in scenario.context_at(frame) {
            self.obstacles.push(state.footprint(&logged.agent));
            self.obstacle_numbers.push(number);
            if has_levels {
                self.obstacle_heights.push(logged.heights.get(frame).copied().flatten());
            }
        }
    }
}
