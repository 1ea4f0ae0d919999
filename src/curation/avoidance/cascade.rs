//! Who responds, in which order, and who must respond to that.

use std::collections::{BTreeMap, VecDeque};

use super::respond::respond;
use super::traffic::{Traffic, logged_at, nearer, reaction_step};
use super::{AvoidanceSettings, Unavoidable, check};
use crate::curation::{CANDIDATE_STATES, Certificate};
use crate::scene::{AgentState, FUTURE, Scenario};

/// How often one agent's response is looked for anew.
const MOST_ATTEMPTS: usize = 4;
/// How often everything is begun anew, with the agent first that found no response.
const MOST_RESTARTS: usize = 2;

/// Finds a response of every agent that `candidate` (81 states, steps 0 to 80, scenario frame) disturbs under log replay, and of those
/// whom these responses disturb.
///
/// With the responses found, and everybody else as in the log, no vehicle touches the AV or comes within half a second of it, no
/// pedestrian or cyclist touches it, and no two agents overlap that do not overlap in the log: the metrics say so on the whole scene. A
/// candidate that disturbs nobody has a certificate without responses.
///
/// # Errors
/// [`Unavoidable`] with the agent for which no response was found, and why.
pub fn certify(
    scenario: &Scenario,
    candidate: &[AgentState],
    settings: &AvoidanceSettings,
) -> Result<Certificate, Unavoidable> {
    let found = candidate.iter().filter(|s| s.is_finite()).count();
    if found != CANDIDATE_STATES || candidate.len() != CANDIDATE_STATES {
        return Err(Unavoidable::Malformed { found });
    }
    let mut traffic = Traffic::new(scenario, candidate);
    let conflicts = check::conflicts(&traffic);
    if conflicts.is_empty() {
        return Ok(Certificate::default());
    }
    let reaction = reaction_step(settings, |k| candidate[k], |k| logged_at(scenario, 0, k)).unwrap_or(FUTURE);
    if let Some(&(i, step)) = conflicts.iter().find(|c| c.1 <= reaction) {
        return Err(Unavoidable::TooEarly { agent: scenario.start.agents[i].id.clone(), step, reaction });
    }
    let mut order: Vec<usize> = conflicts.iter().map(|c| c.0).collect();
    for restart in 0.. {
        let mut cascade = Cascade::new(&mut traffic, settings, reaction, &order);
        match cascade.run() {
            Ok(()) => break,
            Err((agent, why)) => {
                // Somebody else's response may be in the way: this agent chooses first.
                let first = order.first() == Some(&agent);
                if restart == MOST_RESTARTS || first || !order.contains(&agent) {
                    return Err(why);
                }
                order.retain(|&i| i != agent);
                order.insert(0, agent);
            }
        }
    }
    check::settled(&traffic)?;
    Ok(Certificate { responses: traffic.planned.into_values().map(|p| p.response).collect() })
}

/// An agent that has to respond.
#[derive(Clone, Copy)]
struct Task {
    agent: usize,
    /// Step up to which it moves as in the log.
    reaction: usize,
    /// Whose response it responds to; `None`: the AV.
    leader: Option<usize>,
}

struct Cascade<'c, 'a> {
    traffic: &'c mut Traffic<'a>,
    settings: &'c AvoidanceSettings,
    tasks: VecDeque<Task>,
    /// The earliest reaction of everybody who had a task.
    reactions: BTreeMap<usize, usize>,
    attempts: BTreeMap<usize, usize>,
}

impl<'c, 'a> Cascade<'c, 'a> {
    fn new(
        traffic: &'c mut Traffic<'a>,
        settings: &'c AvoidanceSettings,
        reaction: usize,
        order: &[usize],
    ) -> Self {
        traffic.planned.clear();
        let tasks = order.iter().map(|&agent| Task { agent, reaction, leader: None }).collect();
        let reactions = order.iter().map(|&agent| (agent, reaction)).collect();
        Self { traffic, settings, tasks, reactions, attempts: BTreeMap::new() }
    }

    fn run(&mut self) -> Result<(), (usize, Unavoidable)> {
        while let Some(task) = self.tasks.pop_front() {
            let agent = task.agent;
            let id = |i: usize| self.traffic.scenario.start.agents[i].id.clone();
            let attempts = self.attempts.entry(agent).or_default();
            *attempts += 1;
            if *attempts > MOST_ATTEMPTS {
                return Err((agent, Unavoidable::Unsettled { agent: id(agent) }));
            }
            self.traffic.planned.remove(&agent);
            if self.traffic.planned.len() == self.settings.max_agents {
                return Err((agent, Unavoidable::TooMany { limit: self.settings.max_agents }));
            }
            let planned = respond(self.traffic, agent, task.reaction, self.settings).map_err(|reason| {
                let why = match task.leader {
                    None => reason,
                    Some(leader) => Unavoidable::Follower {
                        agent: id(agent),
                        leader: id(leader),
                        reason: Box::new(reason),
                    },
                };
                (agent, why)
            })?;
            self.traffic.planned.insert(agent, planned);
            self.disturbed_by(agent);
        }
        Ok(())
    }

    /// Gives a task to everybody whom a new response disturbs.
    fn disturbed_by(&mut self, agent: usize) {
        let Some(planned) = self.traffic.planned.get(&agent) else { return };
        let scenario = self.traffic.scenario;
        let track = &planned.response.track;
        let seen = reaction_step(self.settings, |k| track[k], |k| logged_at(scenario, agent, k));
        let disturbed: Vec<usize> = (1..self.traffic.len())
            .filter(|&i| i != agent && self.overlaps(agent, i) && self.traffic.log_distance(agent, i) >= 0.0)
            .collect();
        for i in disturbed {
            let seen = seen.unwrap_or(FUTURE).min(FUTURE);
            let reaction = self.reactions.get(&i).map_or(seen, |&r| r.min(seen));
            self.reactions.insert(i, reaction);
            let again = self.tasks.iter().any(|t| t.agent == i);
            if !again {
                self.tasks.push_back(Task { agent: i, reaction, leader: Some(agent) });
            }
        }
    }

    fn overlaps(&self, a: usize, b: usize) -> bool {
        let ((mine, extent), (theirs, other)) = (self.traffic.boxes(a), self.traffic.boxes(b));
        extent.intersects(other)
            && mine
                .iter()
                .zip(theirs)
                .skip(1)
                .any(|(a, b)| a.as_ref().zip(b.as_ref()).is_some_and(|(a, b)| nearer(a, b, 0.0)))
    }
}
