//! Questions of a traffic engineer to `idm`, each as a small hand-built scene. Several are failures of other
//! programs' rule-based agents.

mod conflicts;
mod following;
mod identity;
mod logs;
mod roads;
mod signals;

use reactsim::rollout::Rollout;
use reactsim::scene::{AgentState, Scenario};

use crate::scenes::{accelerations, contact, future};

/// Largest deceleration of any agent, m/s².
const HARDEST: f64 = 5.5;

/// Fails if two agents overlap.
#[track_caller]
fn no_contact(scenario: &Scenario, rollout: &Rollout) {
    if let Some((step, a, b)) = contact(scenario, rollout) {
        panic!("{}: `{a}` and `{b}` overlap at step {step}", scenario.id);
    }
}

/// Returns the track of an agent; fails if it brakes harder than [`HARDEST`].
#[track_caller]
fn braking_within_limits(scenario: &Scenario, rollout: &Rollout, id: &str) -> Vec<AgentState> {
    let track = future(scenario, rollout, id);
    let hardest = accelerations(&track).into_iter().fold(0.0, f64::min);
    assert!(hardest >= -HARDEST - 0.05, "{}: `{id}` brakes at {hardest:.2} m/s2", scenario.id);
    track
}

/// Returns the speed at the end, m/s.
fn last_speed(track: &[AgentState]) -> f64 {
    track[track.len() - 1].speed()
}
