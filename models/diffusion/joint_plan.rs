//! Execution of joint plans: states that a network predicted for some of the agents.

use reactsim_rollout::{NOT_FINITE, Planning};
use reactsim_scene::dynamics::STANDSTILL_SPEED;
use reactsim_scene::{AgentState, DT};

/// Distance in metres: a standing agent stays if its plan for the next second is shorter.
const SET_OFF_DISTANCE: f64 = 0.2;
/// Number of frames of that second.
const SET_OFF_FRAMES: usize = 10;

/// Lets agents execute the first steps of their plans: states by slot, after 0.1 s each. Agents without a
/// plan, and those whose plan is not finite, keep their velocity; so do agents beyond the end of a plan.
pub fn execute(plans: &[(usize, Vec<AgentState>)], episode: &mut Planning<'_, '_>) {
    let steps = episode.plan.steps();
    for slot in 0..episode.plan.agents() {
        let Some(now) = episode.seen.state(slot) else { continue };
        let plan = plans.iter().find(|(planned, _)| *planned == slot).map(|(_, states)| &states[..]);
        let states = match plan.filter(|plan| plan.iter().all(|s| s.is_finite() && s.velocity().is_some())) {
            Some(plan) => along(plan, now, steps),
            None => {
                if plan.is_some() {
                    episode.count(NOT_FINITE);
                }
                go_on(now, steps)
            }
        };
        for (k, state) in states.into_iter().enumerate() {
            episode.plan.set(slot, k, Some(state));
        }
    }
}

/// Returns the states of the next steps by a plan; agents that stand and hardly move within a second stay.
fn along(plan: &[AgentState], now: AgentState, steps: usize) -> Vec<AgentState> {
    let stands = now.velocity().is_none_or(|v| v.norm() < STANDSTILL_SPEED);
    let soon = plan.get(SET_OFF_FRAMES - 1).or(plan.last());
    if stands && soon.is_none_or(|s| (s.position() - now.position()).norm() < SET_OFF_DISTANCE) {
        return vec![AgentState { vx: 0.0, vy: 0.0, ..now }; steps];
    }
    let mut states: Vec<AgentState> = plan.iter().take(steps).copied().collect();
    states.extend(go_on(plan.last().copied().unwrap_or(now), steps - states.len()));
    states
}

/// Returns the states of an agent that keeps its velocity.
pub(crate) fn go_on(now: AgentState, steps: usize) -> Vec<AgentState> {
    let v = now.velocity().unwrap_or_default();
    let after = |k: usize| {
        let p = now.position() + v * (k as f64 * DT);
        AgentState { x: p.x, y: p.y, heading: now.heading, vx: v.x, vy: v.y }
    };
    (1..=steps).map(after).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(x: f64, vx: f64) -> AgentState {
        AgentState { x, y: 2.0, heading: 0.0, vx, vy: 0.0 }
    }

    #[test]
    fn agents_go_on_beyond_their_plans() {
        let states = along(&[at(1.0, 10.0), at(2.0, 12.0)], at(0.0, 10.0), 4);
        let x: Vec<f64> = states.iter().map(|s| s.x).collect();
        assert!(x.iter().zip([1.0, 2.0, 3.2, 4.4]).all(|(x, wanted)| (x - wanted).abs() < 1e-12), "{x:?}");
        assert_eq!(along(&[at(1.0, 10.0), at(2.0, 12.0)], at(0.0, 10.0), 1), [at(1.0, 10.0)]);
    }

    #[test]
    fn agents_that_stand_set_off_by_more_than_a_twitch() {
        let creeping: Vec<AgentState> = (1..=10).map(|k| at(0.01 * f64::from(k), 0.1)).collect();
        assert_eq!(along(&creeping, at(0.0, 0.0), 5), [at(0.0, 0.0); 5]);
        let leaving: Vec<AgentState> = (1..=10).map(|k| at(0.03 * f64::from(k), 0.3)).collect();
        assert_eq!(along(&leaving, at(0.0, 0.0), 5), leaving[..5]);
    }
}
