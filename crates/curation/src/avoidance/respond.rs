//! The response of one agent: by speed along its own path or, failing that, also with a lateral shift.

use reactsim_scene::AgentKind;

use super::own_path::OwnPath;
use super::problem::{Problem, YieldAssumption};
use super::responder::Responder;
use super::traffic::{PlannedResponse, Traffic};
use super::{AvoidanceSettings, Unavoidable};

/// Largest second derivative of the smooth step from 0 to 1.
const SMOOTH_STEP_CURVATURE: f64 = 5.78;
/// Share of the lateral acceleration available to a shift, because the path may bend.
const SHIFT_SHARE: f64 = 0.6;
/// Largest curvature that a shift may add to that of the path, 1/m.
const SHIFT_CURVATURE: f64 = 0.15;

/// Finds a response of an agent to all others as they currently move: by speed or, failing that, with a
/// shift. If neither is found, the search is repeated under the assumption that more others yield.
pub(super) fn respond(
    traffic: &Traffic<'_>,
    agent: usize,
    reaction: usize,
    settings: &AvoidanceSettings,
) -> Result<PlannedResponse, Unavoidable> {
    let info = &traffic.scenario.start.agents[agent];
    if traffic.is_parked(agent) {
        return Err(Unavoidable::Standing { agent: info.id.clone() });
    }
    let Some(responder) = Responder::new(traffic, agent, reaction, settings) else {
        return Err(Unavoidable::Absent { agent: info.id.clone() });
    };
    let problem = Problem::new(traffic, &responder, settings);
    let mut why = None;
    for assumption in [YieldAssumption::Followers, YieldAssumption::FollowersAndLaterCrossers] {
        match problem.along(&responder.path, assumption) {
            Ok(planned) => return Ok(planned),
            Err(reason) if why.is_none() => why = Some(reason),
            Err(_) => {}
        }
        for path in nudged(&responder, info.kind, settings) {
            if let Ok(planned) = problem.along(&path, assumption) {
                return Ok(planned);
            }
        }
    }
    Err(why.unwrap_or(Unavoidable::Absent { agent: info.id.clone() }))
}

/// Returns the paths of a vehicle with a shift to either side, small shifts first.
fn nudged(responder: &Responder, kind: AgentKind, settings: &AvoidanceSettings) -> Vec<OwnPath> {
    if kind != AgentKind::Vehicle || !(settings.max_nudge > 0.0) {
        return Vec::new();
    }
    let along = |share: f64| {
        let nudge = share * settings.max_nudge;
        let grip = SHIFT_SHARE * settings.max_lateral_acceleration;
        let by_grip = responder.motion.speed * (SMOOTH_STEP_CURVATURE * nudge.abs() / grip).sqrt();
        let by_steering = (SMOOTH_STEP_CURVATURE * nudge.abs() / SHIFT_CURVATURE).sqrt();
        responder.path.nudged(nudge, by_grip.max(by_steering))
    };
    [0.5, -0.5, 1.0, -1.0].map(along).to_vec()
}
