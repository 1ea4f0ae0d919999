//! Conflicts as the metrics count them, before and after the responses.

use reactsim_metrics::{Case, Options, metric};
use reactsim_scene::{AgentKind, Frame, Scenario};

use super::Unavoidable;
use super::traffic::{Boxes, Traffic, is_nearer};

/// Returns the agents in conflict with the AV and the first step of each conflict, ordered by step:
/// vehicles that come within half a second of it or touch it, pedestrians and cyclists that touch it.
pub(super) fn conflicts(traffic: &Traffic<'_>, case: &Case<'_>) -> Vec<(usize, usize)> {
    let mut found: Vec<(usize, usize)> = vehicles(traffic.scenario, case);
    for i in (1..traffic.len()).filter(|&i| case.evaluated(i)) {
        if traffic.scenario.start.agents[i].kind != AgentKind::Vehicle && !traffic.never_meet(0, i) {
            found.extend(first_touch(traffic, traffic.boxes(i).0).map(|step| (i, step)));
        }
    }
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
    let on_foot = |i: &usize| agents[*i].kind != AgentKind::Vehicle && !traffic.never_meet(0, *i);
    for i in (1..traffic.len()).filter(on_foot) {
        if let Some(step) = first_touch(traffic, traffic.boxes(i).0) {
            return Err(fail(i, "aav-overlap", step));
        }
    }
    let mut events = Vec::new();
    if let Some(m) = metric("aa-collision") {
        m.score(&case, &mut events);
    }
    for event in events {
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
    let mut events = Vec::new();
    if let Some(m) = metric("aav-ttc") {
        m.score(case, &mut events);
    }
    let slot = |id: &str| scenario.start.agents.iter().position(|a| a.id == id);
    events.iter().filter_map(|e| Some((slot(&e.agent)?, e.step))).collect()
}

fn first_touch(traffic: &Traffic<'_>, boxes: &Boxes) -> Option<usize> {
    (1..boxes.len()).find(|&k| boxes[k].as_ref().is_some_and(|b| is_nearer(b, &traffic.av_box(k), 0.0)))
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
