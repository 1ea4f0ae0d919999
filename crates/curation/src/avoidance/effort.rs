//! The effort of each responding agent: the least deceleration, and the time to react.

use reactsim_scene::{DT, Effort};

use super::AvoidanceSettings;
use super::respond::respond;
use super::traffic::{Traffic, reaction_steps};

/// Resolution of the search for the least deceleration, m/s².
const DECELERATION_RESOLUTION: f64 = 0.1;
/// Largest deceleration of an agent that responds as late as possible, m/s²: the bound of a feasible
/// transition.
const LATE_RESPONSE_DECELERATION: f64 = 6.0;

/// Measures the effort of every response in `traffic`, with all other agents as they move there.
///
/// `conflicts` holds the agents that conflict with the AV under log replay, with the first such step.
pub(super) fn measure(traffic: &mut Traffic<'_>, conflicts: &[(usize, usize)], settings: &AvoidanceSettings) {
    let agents: Vec<usize> = traffic.planned.keys().copied().collect();
    for agent in agents {
        let Some(mut planned) = traffic.planned.remove(&agent) else { continue };
        let response = &mut planned.response;
        // A response by speed alone is compared with responses by speed alone.
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

/// The searches for one agent.
struct Search<'s, 'a> {
    traffic: &'s Traffic<'a>,
    agent: usize,
    settings: AvoidanceSettings,
}

impl Search<'_, '_> {
    /// Returns the first step at which the agent conflicts with another one if it continues as in its
    /// log.
    fn first_conflict(&self, conflicts: &[(usize, usize)]) -> usize {
        let with_av = conflicts.iter().find(|c| c.0 == self.agent).map(|c| c.1);
        let responding =
            self.traffic.planned.keys().filter_map(|&other| self.traffic.breach(self.agent, other));
        responding.chain(with_av).min().unwrap_or(self.traffic.steps())
    }

    /// Returns the smallest bound of the deceleration for which a response exists, m/s², given one with
    /// the peak `known`.
    fn least_deceleration(&self, reaction: usize, known: f64) -> f64 {
        let (mut least, mut too_little) = (known, 0.0);
        while least - too_little > DECELERATION_RESOLUTION {
            let bound = 0.5 * (least + too_little);
            let settings = AvoidanceSettings { max_deceleration: bound, ..self.settings };
            match respond(self.traffic, self.agent, reaction, &settings) {
                Ok(found) => least = found.response.peak_deceleration.min(bound),
                Err(_) => too_little = bound,
            }
        }
        least
    }

    /// Returns the time from the step at which the conflict becomes visible to the last step from which
    /// a response is possible, s.
    ///
    /// A response exists from the step `known`, and none from `end` on.
    fn time_to_react(&self, known: usize, end: usize) -> f64 {
        let settings = AvoidanceSettings { max_deceleration: LATE_RESPONSE_DECELERATION, ..self.settings };
        let (mut latest, mut too_late) = (known, end.max(known + 1));
        while too_late - latest > 1 {
            let step = usize::midpoint(latest, too_late);
            match respond(self.traffic, self.agent, step, &settings) {
                // An agent that is absent at this step responds later than requested, or not at all.
                Ok(found) if found.response.reaction_step == step => latest = step,
                _ => too_late = step,
            }
        }
        let seen = known.saturating_sub(reaction_steps(&self.settings));
        (latest - seen) as f64 * DT
    }
}
