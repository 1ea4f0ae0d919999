//! Conflicts as the metrics count them, before and after the responses.

use reactsim_metrics::{Case, Event, Options, metric};
use reactsim_scene::{AgentKind, Frame, Scenario};

use super::Unavoidable;
use super::traffic::{Traffic, is_nearer};

/// Returns the agents in conflict with the AV and the first step of each conflict, ordered by step:
/// vehicles that come within half a second of it or touch it, pedestrians and cyclists that touch it.
pub(super) fn conflicts(traffic: &Traffic<'_>, case: &Case<'_>) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = vehicles(traffic.scenario, case);
    found.extend(touches(traffic).filter(|&(i, _)| case.evaluated(i)));
    found.sort_by_key(|&(i, step)| (step, i));
    found
}

/// Fails if a conflict remains: a contact with the AV or a risky approach; an overlap of agents, or of a
/// responding one and an obstacle, that the log does not excuse; or a response to something that was not
/// visible yet.
///
/// `direct` holds the agents in conflict with the AV, which react to the AV after the step `reaction`;
/// all others react to another response.
pub(super) fn check_settled(
    traffic: &Traffic<'_>,
    direct: &[usize],
    reaction: usize,
) -> Result<(), Unavoidable> {
    let case = case(traffic);
    let agents = &traffic.scenario.start.agents;
    let fail = |i: usize, metric: &str, step: usize| Unavoidable::Check {
        agent: agents[i].id.clone(),
        metric: metric.to_owned(),
        step,
    };
    if let Some(&(i, step)) = vehicles(traffic.scenario, &case).first() {
        return Err(fail(i, "aav-ttc", step));
    }
    if let Some((i, step)) = touches(traffic).next() {
        return Err(fail(i, "aav-overlap", step));
    }
    for event in events("aa-collision", &case) {
        let slot = |id: &str| agents.iter().position(|a| a.id == id);
        let partner = event.partner.as_deref().and_then(slot);
        let Some((i, j)) = slot(&event.agent).zip(partner) else { continue };
        if let Some(step) = traffic.breach(i, j) {
            return Err(fail(i, "aa-collision", step));
        }
    }
    for (&i, planned) in &traffic.planned {
        if let Some(step) = (traffic.len()..traffic.bodies()).find_map(|o| traffic.breach(i, o)) {
            return Err(fail(i, "obstacle", step));
        }
        let from = planned.response.reaction_step;
        let seen = traffic.planned.iter().any(|(&j, other)| j != i && other.others_reaction_step <= from);
        let may = if direct.contains(&i) { from >= reaction } else { seen };
        if !may {
            return Err(Unavoidable::Unsettled { agent: agents[i].id.clone() });
        }
    }
    Ok(())
}

/// Returns risky vehicles (including those that touch the AV) with the first such step.
fn vehicles(scenario: &Scenario, case: &Case<'_>) -> Vec<(usize, usize)> {
    let slot = |id: &str| scenario.start.agents.iter().position(|a| a.id == id);
    events("aav-ttc", case).iter().filter_map(|e| Some((slot(&e.agent)?, e.step))).collect()
}

/// Returns the events that a metric counts.
fn events(id: &str, case: &Case<'_>) -> Vec<Event> {
    let mut events = Vec::new();
    if let Some(metric) = metric(id) {
        metric.score(case, &mut events);
    }
    events
}

/// Returns the agents other than vehicles that touch the AV, with the first such step.
fn touches(traffic: &Traffic<'_>) -> impl Iterator<Item = (usize, usize)> {
    let is_other = |i: &usize| traffic.scenario.start.agents[*i].kind != AgentKind::Vehicle;
    (1..traffic.len()).filter(is_other).filter(|&i| !traffic.never_meet(0, i)).filter_map(|i| {
        let boxes = traffic.boxes(i).0;
        let touch = |k: &usize| boxes[*k].as_ref().is_some_and(|b| is_nearer(b, &traffic.av_box(*k), 0.0));
        Some((i, (1..boxes.len()).find(touch)?))
    })
}

/// Returns the scene with all agents as they currently move.
pub(super) fn case<'a>(traffic: &Traffic<'a>) -> Case<'a> {
    let (scenario, length) = (traffic.scenario, traffic.scenario.length());
    let track = |i: usize| -> Vec<Frame> {
        let mut track = scenario.logged(i);
        if i == 0 {
            track.truncate(length.history);
            track.extend(traffic.av[1..].iter().copied().map(Some));
        } else if let Some(planned) = traffic.planned.get(&i) {
            let response = &planned.response;
            track.truncate(length.history + response.reaction_step);
            track.extend(response.track[1 + response.reaction_step..].iter().copied().map(Some));
        }
        debug_assert_eq!(track.len(), length.frames(), "history and future");
        track
    };
    Case::of_rollout(scenario, (0..traffic.len()).map(track), Options::default())
}
