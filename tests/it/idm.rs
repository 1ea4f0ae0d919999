//! What a traffic engineer would ask of `idm`, each question a small hand-built scene. Several are failures of other programs'
//! rule-based agents.

mod conflicts;
mod following;
mod identity;
mod logs;
mod roads;
mod signals;

use reactsim::rollout::Rollout;
use reactsim::scene::{AgentState, Scenario};

use crate::scenes::{accelerations, contact, future};

/// Nobody brakes harder, m/s².
const HARDEST: f64 = 5.5;

/// Fails where two agents overlap.
#[track_caller]
fn no_contact(scenario: &Scenario, rollout: &Rollout) {
    if let Some((step, a, b)) = contact(scenario, rollout) {
        panic!("{}: `{a}` and `{b}` overlap at step {step}", scenario.id);
    }
}

/// The track of an agent that brakes no harder than drivers here do.
#[track_caller]
fn braking_within_limits(scenario: &Scenario, rollout: &Rollout, id: &str) -> Vec<AgentState> {
    let track = future(scenario, rollout, id);
    let hardest = accelerations(&track).into_iter().fold(0.0, f64::min);
    assert!(hardest >= -HARDEST - 0.05, "{}: `{id}` brakes at {hardest:.2} m/s2", scenario.id);
    track
}

/// Speed at the end, m/s.
fn last_speed(track: &[AgentState]) -> f64 {
    track[track.len() - 1].speed()
}
