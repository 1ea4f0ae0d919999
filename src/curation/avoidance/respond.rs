//! The response of one agent: by speed along its own path, else with a sideways shift too.

use super::driver::Driver;
use super::own_path::OwnPath;
use super::solver::Solver;
use super::traffic::{Planned, Traffic};
use super::{AvoidanceSettings, Unavoidable};
use crate::scene::AgentKind;

/// The largest second derivative of the smooth step from 0 to 1.
const SMOOTH_STEP_BEND: f64 = 5.78;
/// Share of the lateral acceleration that is left to a shift, on a path that bends.
const SHIFT_SHARE: f64 = 0.6;
/// Curvature that a shift may add to that of the path, 1/m.
const SHIFT_CURVATURE: f64 = 0.15;

/// Who else is expected to respond where this agent does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Courtesy {
    /// Those who come from behind.
    OfFollowers,
    /// Those too who cross the path of this agent after it in the log.
    OfAllWhoComeLater,
}

/// Finds a response of an agent against everybody as they move now: by speed, else with a shift; and where neither is found, the same
/// again with more courtesy of others.
pub(super) fn respond(
    traffic: &Traffic<'_>,
    agent: usize,
    reaction: usize,
    settings: &AvoidanceSettings,
) -> Result<Planned, Unavoidable> {
    let who = &traffic.scenario.start.agents[agent];
    if traffic.stands(agent) {
        return Err(Unavoidable::Standing { agent: who.id.clone() });
    }
    let Some(driver) = Driver::new(traffic, agent, reaction, settings) else {
        return Err(Unavoidable::Absent { agent: who.id.clone() });
    };
    let solver = Solver::new(traffic, &driver, settings);
    let mut why = None;
    for courtesy in [Courtesy::OfFollowers, Courtesy::OfAllWhoComeLater] {
        match solver.along(&driver.path, courtesy) {
            Ok(planned) => return Ok(planned),
            Err(reason) if why.is_none() => why = Some(reason),
            Err(_) => {}
        }
        for path in nudged(&driver, who.kind, settings) {
            if let Ok(planned) = solver.along(&path, courtesy) {
                return Ok(planned);
            }
        }
    }
    Err(why.unwrap_or(Unavoidable::Absent { agent: who.id.clone() }))
}

/// The paths of a vehicle with a shift to either side, the small ones first.
fn nudged(driver: &Driver, kind: AgentKind, settings: &AvoidanceSettings) -> Vec<OwnPath> {
    if kind != AgentKind::Vehicle || !(settings.max_nudge > 0.0) {
        return Vec::new();
    }
    let along = |share: f64| {
        let nudge = share * settings.max_nudge;
        let grip = SHIFT_SHARE * settings.max_lateral_acceleration;
        let by_grip = driver.motion.speed * (SMOOTH_STEP_BEND * nudge.abs() / grip).sqrt();
        let by_steering = (SMOOTH_STEP_BEND * nudge.abs() / SHIFT_CURVATURE).sqrt();
        driver.path.nudged(nudge, by_grip.max(by_steering))
    };
    [0.5, -0.5, 1.0, -1.0].map(along).to_vec()
}
