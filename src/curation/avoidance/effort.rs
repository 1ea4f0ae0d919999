//! The least that a conflict asks of each agent that responds: how hard it must brake, and how long it may wait.

use super::AvoidanceSettings;
use super::respond::respond;
use super::traffic::{Traffic, reaction_steps};
use crate::scene::{DT, Effort, FUTURE};

/// Step at which the search for the least deceleration ends, m/s².
const DECELERATION_STEP: f64 = 0.1;
/// Braking that an agent is granted that responds as late as it can, m/s²: the bound of a feasible transition.
const LATEST_DECELERATION: f64 = 6.0;

/// Measures the effort of every response of `traffic`, with all other agents as they move there. `conflicts`: the agents that conflict with
/// the AV under log replay, with the first such step.
pub(super) fn measure(traffic: &mut Traffic<'_>, conflicts: &[(usize, usize)], settings: &AvoidanceSettings) {
    let agents: Vec<usize> = traffic.planned.keys().copied().collect();
    for agent in agents {
        let Some(mut planned) = traffic.planned.remove(&agent) else { continue };
        let response = &mut planned.response;
        // A response by speed alone is compared with others by speed alone.
        let max_nudge = if response.nudge == 0.0 { 0.0 } else { settings.max_nudge };
        let search = Search { traffic, agent, settings: AvoidanceSettings { max_nudge, ..*settings } };
        let end = search.first_conflict(conflicts);
        response.effort = Some(Effort {
            required_deceleration: search
                .least_deceleration(response.reaction_step, response.peak_deceleration),
            time_to_react: search.time_to_react(response.reaction_step, end),
        });
        traffic.planned.insert(agent, planned);
    }
}

/// The question of one agent.
struct Search<'s, 'a> {
    traffic: &'s Traffic<'a>,
    agent: usize,
    settings: AvoidanceSettings,
}

impl Search<'_, '_> {
    /// The first step at which the agent conflicts with somebody if it goes on as in its log.
    fn first_conflict(&self, conflicts: &[(usize, usize)]) -> usize {
        let with_av = conflicts.iter().find(|c| c.0 == self.agent).map(|c| c.1);
        let responding =
            self.traffic.planned.keys().filter_map(|&other| self.traffic.breach(self.agent, other));
        responding.chain(with_av).min().unwrap_or(FUTURE)
    }

    /// The smallest bound of the deceleration with which there is a response, where there is one with the peak `known`, m/s².
    fn least_deceleration(&self, reaction: usize, known: f64) -> f64 {
        let (mut least, mut too_little) = (known, 0.0);
        while least - too_little > DECELERATION_STEP {
            let bound = 0.5 * (least + too_little);
            let settings = AvoidanceSettings { max_deceleration: bound, ..self.settings };
            match respond(self.traffic, self.agent, reaction, &settings) {
                Ok(found) => least = found.response.peak_deceleration.min(bound),
                Err(_) => too_little = bound,
            }
        }
        least
    }

    /// Seconds from the step at which the conflict can first be seen to the last step from which a response is possible, where there is one
    /// from the step `known`, and from `end` on there is none.
    fn time_to_react(&self, known: usize, end: usize) -> f64 {
        let settings = AvoidanceSettings { max_deceleration: LATEST_DECELERATION, ..self.settings };
        let (mut latest, mut too_late) = (known, end.max(known + 1));
        while too_late - latest > 1 {
            let step = usize::midpoint(latest, too_late);
            match respond(self.traffic, self.agent, step, &settings) {
                // An agent that has left the log meanwhile responds later than it was asked to, or not at all.
                Ok(found) if found.response.reaction_step == step => latest = step,
                _ => too_late = step,
            }
        }
        let seen = known.saturating_sub(reaction_steps(&self.settings));
        (latest - seen) as f64 * DT
    }
}
