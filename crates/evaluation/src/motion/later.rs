//! Motion after the first step: teleports, repeated frames, and agents that stop dead.

use reactsim_geometry::Vec2;
use reactsim_scene::{AgentKind, DT};

use super::{CheckedMotion, CheckedScene, Finding};
use crate::motion::kind::RolloutCheck;

/// Speed from which an agent that stops within one step stops dead, m/s: 30 m/s² at least.
const DEAD_STOP: f64 = 3.0;
/// Number of steps that an agent that stopped dead stays.
const STAYS: usize = 10;
/// Longest period of repeated frames, steps.
const LONGEST_PERIOD: usize = 20;

/// Returns the largest speed of a class, m/s.
fn top_speed(kind: AgentKind) -> f64 {
    match kind {
        AgentKind::Vehicle | AgentKind::Other => 80.0,
        AgentKind::Cyclist => 40.0,
        AgentKind::Pedestrian => 25.0,
    }
}

/// Largest change of the displacement from one step to the next, metres: 500 m/s².
const TELEPORT: f64 = 5.0;

fn position(agent: &CheckedMotion<'_>, k: usize) -> Option<Vec2> {
    match k {
        0 => Some(agent.now.position()),
        k => Some(agent.future.get(k - 1)?.as_ref()?.position()),
    }
}

/// Checks for positions that no road user reaches in 0.1 s.
pub(super) fn teleports(scene: &CheckedScene<'_>) -> Option<Finding> {
    let teleport = |agent: &CheckedMotion<'_>| {
        (2..=agent.future.len()).find_map(|k| {
            let (a, b, c) = (position(agent, k - 2)?, position(agent, k - 1)?, position(agent, k)?);
            let by = (c - b).norm();
            let change = ((c - b) - (b - a)).norm();
            (by > top_speed(agent.kind) * DT || change > TELEPORT).then_some((k, by))
        })
    };
    let entered = scene.entered.iter().map(|(first, agent)| (*first, agent));
    let all: Vec<(usize, &CheckedMotion<'_>)> =
        scene.agents.iter().map(|agent| (0, agent)).chain(entered).collect();
    let found: Vec<_> =
        all.iter().filter_map(|(first, a)| teleport(a).map(|(k, by)| (a, first + k, by))).collect();
    let (agent, step, by) = found.first()?;
    Some(Finding::new(
        RolloutCheck::Teleports,
        format!(
            "{} of {} agents teleport, the first: `{}` ({}) moves {by:.1} m from step {} to step {step}, which \
             no {} can do in 0.1 s; answer with every step of the motion, in metres",
            found.len(),
            all.len(),
            agent.id,
            agent.kind,
            step - 1,
            agent.kind,
        ),
    ))
}

/// Checks for frames that occur again.
pub(super) fn repeated(scene: &CheckedScene<'_>) -> Option<Finding> {
    let period = |agent: &CheckedMotion<'_>| {
        (2..=LONGEST_PERIOD).find(|p| {
            let all = |k: usize| position(agent, k).zip(position(agent, k + p));
            let moved = position(agent, 1).zip(position(agent, *p)).map_or(0.0, |(a, b)| (b - a).norm());
            moved >= 0.5 && (1..=*p).all(|k| all(k).is_some_and(|(a, b)| (a - b).norm() <= 1e-6))
        })
    };
    let found: Vec<_> = scene.agents.iter().filter_map(|a| period(a).map(|p| (a, p))).collect();
    if found.len() < scene.least(2) {
        return None;
    }
    let (agent, period) = found.first()?;
    Some(Finding::new(
        RolloutCheck::Time,
        format!(
            "the same {period} frames occur again for {} of {} agents, the first `{}`: the plans look made from a \
             history that is not continued; continue from the latest frame of the states",
            found.len(),
            scene.agents.len(),
            agent.id
        ),
    ))
}

/// Checks for moving agents that stop within one step and stay.
pub(super) fn freeze(scene: &CheckedScene<'_>) -> Option<Finding> {
    let mut moving = 0;
    let mut frozen = Vec::new();
    for agent in &scene.agents {
        let steps = agent.future.len();
        let speed = |k: usize| match k {
            0 => Some(agent.speed()),
            k => position(agent, k - 1).zip(position(agent, k)).map(|(a, b)| (b - a).norm() / DT),
        };
        moving += usize::from((0..=steps).any(|k| speed(k).is_some_and(|v| v >= DEAD_STOP)));
        let stays =
            |k: usize| (k + STAYS <= steps) && (k..steps).all(|j| speed(j + 1).is_some_and(|v| v <= 1e-3));
        let stop = (0..steps).find(|k| speed(*k).is_some_and(|v| v >= DEAD_STOP) && stays(*k));
        frozen.extend(stop.map(|k| (agent, k, speed(k).unwrap_or_default())));
    }
    if frozen.len() < scene.least(2) || 4 * frozen.len() < moving {
        return None;
    }
    let (agent, step, speed) = frozen.first()?;
    Some(Finding::new(
        RolloutCheck::Freeze,
        format!(
            "{} of {moving} moving agents stop dead and stay, the first: `{}` from {speed:.1} m/s after step \
             {step}; this looks like a fallback for numbers that are not finite: find them, or let agents brake",
            frozen.len(),
            agent.id
        ),
    ))
}
