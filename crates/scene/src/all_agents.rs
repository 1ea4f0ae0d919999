//! Scenarios in which all agents are simulated.

use std::sync::OnceLock;

use super::{CURRENT, FRAMES, HISTORY, LoggedAgent, Scenario};

impl Scenario {
    /// Selects all agents with an extent that are present at the current frame, of all kinds and any number,
    /// as the Sim Agents challenge requires; without this the benchmark selects the 63 nearest vehicles,
    /// pedestrians and cyclists. The agents that are added follow those selected before, by distance to the
    /// AV. Obstacles become agents of kind `other`.
    pub fn with_all_agents(mut self) -> Self {
        let av = self.start.now(0).position();
        let is_here = |logged: &LoggedAgent| {
            logged.track[CURRENT].is_some() && logged.agent.length > 0.0 && logged.agent.width > 0.0
        };
        let (mut added, rest): (Vec<LoggedAgent>, Vec<LoggedAgent>) =
            self.unselected.into_iter().partition(is_here);
        let distance = |logged: &LoggedAgent| {
            logged.track[CURRENT].map_or(f64::INFINITY, |state| (state.position() - av).norm())
        };
        // Equally distant agents stay in the order of the file.
        added.sort_by(|a, b| distance(a).total_cmp(&distance(b)));
        for LoggedAgent { agent, mut track, mut heights } in added {
            let future = track.split_off(HISTORY);
            self.start.agents.push(agent);
            self.start.history.push(track);
            self.log_future.tracks.push(future);
            if self.start.has_levels() {
                heights.resize(FRAMES, None);
                self.log_future.heights.push(heights.split_off(HISTORY));
                self.start.heights.push(heights);
            }
        }
        self.start.obstacles.clear();
        self.start.obstacle_heights.clear();
        Self { unselected: rest, notes: OnceLock::new(), ..self }
    }
}
