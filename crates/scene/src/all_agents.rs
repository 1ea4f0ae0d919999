//! Scenarios with agents that the benchmark does not select.

use std::sync::OnceLock;

use super::assemble::WITHOUT_EXTENT;
use super::{LoggedAgent, Scenario};

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
            self.unselected.into_iter().partition(is_here);
        let distance = |logged: &LoggedAgent| {
            logged.track[current].map_or(f64::INFINITY, |state| (state.position() - av).norm())
        };
        // Equally distant agents stay in the order of the file.
        added.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        for LoggedAgent { agent, mut track, mut heights } in added {
            let future = track.split_off(length.history);
            self.start.agents.push(agent);
            self.start.history.push(track);
            self.log_future.tracks.push(future);
            if self.start.has_levels() {
                heights.resize(length.frames(), None);
                self.log_future.heights.push(heights.split_off(length.history));
                self.start.heights.push(heights);
            }
        }
        self.start.obstacles.clear();
        self.start.obstacle_heights.clear();
        self.repairs.remove(WITHOUT_EXTENT);
        Self { unselected: rest, notes: OnceLock::new(), ..self }
    }

    /// Returns the scenario as it is after agents of [`Self::unselected`] entered its rollout, for judging and
    /// drawing: they follow the agents of the beginning in this order, and are absent at the current frame, where
    /// [`Start::now`](super::Start::now) has no state of them.
    pub fn with_entered(&self, entered: &[usize]) -> Self {
        let length = self.length();
        let mut scenario = Self { notes: OnceLock::from(self.notes().clone()), ..self.clone() };
        let has_levels = self.start.has_levels();
        for LoggedAgent { agent, track, heights } in entered.iter().map(|logged| &self.unselected[*logged]) {
            let (history, future) = track.split_at(length.history);
            scenario.start.agents.push(agent.clone());
            scenario.start.history.push(history.to_vec());
            scenario.log_future.tracks.push(future.to_vec());
            if has_levels {
                let mut heights = heights.clone();
                heights.resize(length.frames(), None);
                let future = heights.split_off(length.history);
                // Its height at its first frame is the one from which it is followed.
                let first = (length.history..track.len()).find(|frame| track[*frame].is_some());
                heights[length.current()] = first.and_then(|frame| future[frame - length.history]);
                scenario.start.heights.push(heights);
                scenario.log_future.heights.push(future);
            }
        }
        scenario
    }
}
