//! The order of responses, and the responses to those responses.

use std::collections::{BTreeMap, BTreeSet, VecDeque};

use reactsim_metrics::{Case, pair_counts};
use reactsim_scene::{AgentKind, AgentState, Scenario};

use super::respond::respond;
use super::traffic::{Traffic, reaction_step};
use super::{AvoidanceSettings, Unavoidable, check, effort};
use crate::Certificate;

/// Largest number of searches for one agent's response.
const MAX_ATTEMPTS: usize = 4;
/// Largest number of restarts, each with the agent first that found no response.
const MAX_RESTARTS: usize = 2;

/// Finds a response of every agent that `candidate` (the states from step 0 on, scenario frame) disturbs
/// under log replay, and of those whom these responses disturb.
///
/// With these responses, and all others as in the log, no vehicle touches the AV or comes within half a
/// second of it, no pedestrian or cyclist touches it, and no two agents overlap, except where the log
/// itself has such an overlap (at that time, or as small). The metrics confirm this on the whole scene.
/// A candidate that disturbs nobody has a certificate without responses.
///
/// # Errors
/// [`Unavoidable`] with the agent for which no response was found, and the reason.
pub fn certify(
    scenario: &Scenario,
    candidate: &[AgentState],
    settings: &AvoidanceSettings,
) -> Result<Certificate, Unavoidable> {
    let traffic = prepare(scenario, candidate)?;
    let replayed = check::case(&traffic);
    resolve(traffic, &replayed, settings)
}

/// Like [`certify`], for callers that already have the log replay around the candidate as a [`Case`].
///
/// `replayed` must have the agents of `scenario` in its order, all but the AV as in the log, and the
/// default options.
///
/// # Errors
/// As for [`certify`].
pub fn certify_case(
    scenario: &Scenario,
    candidate: &[AgentState],
    replayed: &Case<'_>,
    settings: &AvoidanceSettings,
) -> Result<Certificate, Unavoidable> {
    resolve(prepare(scenario, candidate)?, replayed, settings)
}

fn prepare<'a>(scenario: &'a Scenario, candidate: &'a [AgentState]) -> Result<Traffic<'a>, Unavoidable> {
    let found = candidate.iter().filter(|s| s.is_finite()).count();
    let expected = scenario.length().future + 1;
    if found != expected || candidate.len() != expected {
        return Err(Unavoidable::Malformed { found, expected });
    }
    Ok(Traffic::new(scenario, candidate))
}

fn resolve(
    mut traffic: Traffic<'_>,
    replayed: &Case<'_>,
    settings: &AvoidanceSettings,
) -> Result<Certificate, Unavoidable> {
    let (scenario, candidate) = (traffic.scenario, traffic.av);
    let conflicts = check::conflicts(&traffic, replayed);
    if conflicts.is_empty() {
        return Ok(Certificate::default());
    }
    let (now, steps) = (scenario.start.current(), traffic.steps());
    let seen = reaction_step(settings, steps, |k| candidate[k], |k| scenario.logged_at(0, now + k));
    let reaction = seen.unwrap_or(steps);
    if let Some(&(i, step)) = conflicts.iter().find(|c| c.1 <= reaction) {
        return Err(Unavoidable::TooEarly { agent: scenario.start.agents[i].id.clone(), step, reaction });
    }
    let mut order: Vec<usize> = conflicts.iter().map(|c| c.0).collect();
    for restart in 0.. {
        let mut cascade = Cascade::new(&mut traffic, settings, reaction, &order);
        match cascade.run() {
            Ok(()) => break,
            Err((agent, why)) => {
                // Another response may block this agent, so it goes first.
                let first = order.first() == Some(&agent);
                if restart == MAX_RESTARTS || first || !order.contains(&agent) {
                    return Err(why);
                }
                order.retain(|&i| i != agent);
                order.insert(0, agent);
            }
        }
    }
    check::check_settled(&traffic, &order, reaction)?;
    effort::measure(&mut traffic, &conflicts, settings);
    Ok(Certificate { responses: traffic.planned.into_values().map(|p| p.response).collect() })
}

/// Search for the responses of all agents.
struct Cascade<'c, 'a> {
    traffic: &'c mut Traffic<'a>,
    settings: &'c AvoidanceSettings,
    /// Agents in conflict with the AV under log replay.
    direct: &'c [usize],
    /// Last step up to which these move as in the log.
    reaction: usize,
    /// Agents whose response is still to be found, or to be found again.
    tasks: VecDeque<usize>,
    /// Agents whose responses have disturbed each agent so far.
    disturbers: BTreeMap<usize, BTreeSet<usize>>,
    attempts: BTreeMap<usize, usize>,
}

impl<'c, 'a> Cascade<'c, 'a> {
    fn new(
        traffic: &'c mut Traffic<'a>,
        settings: &'c AvoidanceSettings,
        reaction: usize,
        direct: &'c [usize],
    ) -> Self {
        traffic.planned.clear();
        let tasks = direct.iter().copied().collect();
        let (disturbers, attempts) = (BTreeMap::new(), BTreeMap::new());
        Self { traffic, settings, direct, reaction, tasks, disturbers, attempts }
    }

    fn run(&mut self) -> Result<(), (usize, Unavoidable)> {
        while let Some(agent) = self.tasks.pop_front() {
            let id = |i: usize| self.traffic.scenario.start.agents[i].id.clone();
            let attempts = self.attempts.entry(agent).or_default();
            *attempts += 1;
            if *attempts > MAX_ATTEMPTS {
                return Err((agent, Unavoidable::Unsettled { agent: id(agent) }));
            }
            self.traffic.planned.remove(&agent);
            // An agent that is no longer disturbed moves as in its log until it is disturbed again.
            let Some((reaction, leader)) = self.cause(agent) else { continue };
            if self.traffic.planned.len() == self.settings.max_agents {
                return Err((agent, Unavoidable::TooMany { limit: self.settings.max_agents }));
            }
            let mut planned = respond(self.traffic, agent, reaction, self.settings).map_err(|reason| {
                let why = match leader {
                    None => reason,
                    Some(leader) => Unavoidable::Follower {
                        agent: id(agent),
                        leader: id(leader),
                        reason: Box::new(reason),
                    },
                };
                (agent, why)
            })?;
            planned.response.leader = leader.map(id);
            self.traffic.planned.insert(agent, planned);
            self.queue_disturbed(agent);
        }
        Ok(())
    }

    /// Returns the last step up to which an agent moves as in its log, and the agent whose response it
    /// responds to (`None`: the AV's deviation). It sees responses as currently planned. `None` if there
    /// is nothing to respond to.
    fn cause(&self, agent: usize) -> Option<(usize, Option<usize>)> {
        if self.direct.contains(&agent) {
            return Some((self.reaction, None));
        }
        let planned =
            self.disturbers.get(&agent)?.iter().filter_map(|j| Some((j, self.traffic.planned.get(j)?)));
        planned.map(|(&j, p)| (p.others_reaction_step, Some(j))).min()
    }

    /// Queues all agents that a new response disturbs, and those that have reacted to an earlier one too
    /// early for this one.
    fn queue_disturbed(&mut self, agent: usize) {
        for i in (1..self.traffic.len()).filter(|&i| i != agent) {
            let counts = pair_counts(self.kind(agent), self.kind(i));
            let disturbed = counts && self.traffic.breach(agent, i).is_some();
            if disturbed {
                self.disturbers.entry(i).or_default().insert(agent);
            }
            let from = self.traffic.planned.get(&i).map(|p| p.response.reaction_step);
            let early = from.is_some_and(|from| self.cause(i).is_none_or(|(reaction, _)| from < reaction));
            if (disturbed || early) && !self.tasks.contains(&i) {
                self.tasks.push_back(i);
            }
        }
    }

    fn kind(&self, agent: usize) -> AgentKind {
        self.traffic.scenario.start.agents[agent].kind
    }
}
