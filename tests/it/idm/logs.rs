//! Whole scenarios: those that ship, and real logs of the training split.

use std::sync::Arc;

use reactsim::geometry::wrap;
use reactsim::metrics::{Event, Scores};
use reactsim::rollout::{Request, Rollout, Script, ScriptedAv, Settings, roll_out};
use reactsim::scene::{AgentState, CURRENT, DT, Scenario};

use super::no_contact;
use crate::scenes::{mini, real, request, scores, slot};

/// Returns whether the recorded state contradicts itself: no vehicle has such speeds and headings.
fn infeasible_start(scenario: &Scenario, agent: usize) -> bool {
    let now = scenario.start.now(agent);
    let Some(velocity) = now.velocity() else { return true };
    // Sideways or backwards: a bicycle model moves along its heading.
    let speed = velocity.norm();
    let drift = wrap(velocity.y.atan2(velocity.x) - now.heading).abs();
    // A velocity that contradicts the positions of the last steps.
    let moved =
        scenario.start.history[agent][CURRENT - 3..].iter().copied().collect::<Option<Vec<AgentState>>>();
    let told = moved.map(|m| (m[3].position() - m[0].position()).norm() / (3.0 * DT));
    (speed > 0.6 && drift > 0.3) || told.is_none_or(|told| (told - speed).abs() > 1.0)
}

/// Returns the violations of Acc. and Steer. that the agent's start does not excuse. Only the first
/// transition, from a contradictory recorded state, is excused.
fn violations(scenario: &Scenario, scores: &Scores) -> Vec<String> {
    let kinematic = |e: &&Event| ["acceleration", "curvature"].contains(&e.metric);
    let excused = |e: &Event| e.last_step == 1 && infeasible_start(scenario, slot(scenario, &e.agent));
    let found = scores.events.iter().filter(kinematic).filter(|e| !excused(e));
    found
        .map(|e| format!("{}: {} of `{}` at step {}: {:?}", scenario.id, e.metric, e.agent, e.step, e.values))
        .collect()
}

fn scripted(scenario: &Scenario, script: &str) -> Rollout {
    let av = ScriptedAv::new(scenario, script.parse::<Script>().unwrap()).unwrap();
    let controller = reactsim::models::find("idm").unwrap().simulator().unwrap();
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: 0 };
    roll_out(vec![request], &controller, &Settings::default()).remove(0).unwrap()
}

const SCRIPTS: [&str; 3] = ["brake:4", "retime:1.6", "shift:2"];

#[test]
fn motion_is_feasible() {
    let (mut found, mut judged) = (Vec::new(), 0);
    for scenario in mini().iter().chain(&real(40)) {
        for script in SCRIPTS {
            let scores = scores(scenario, &scripted(scenario, script));
            judged += usize::from(scores.value("acceleration").is_some());
            found.extend(violations(scenario, &scores).into_iter().map(|v| format!("{script}: {v}")));
        }
    }
    assert!(judged >= 18, "{judged}");
    assert!(found.is_empty(), "{} violations:\n{}", found.len(), found.join("\n"));
}

#[test]
fn the_shipped_deviations_are_survived() {
    for scenario in &mini() {
        let av = scenario.deviation.as_ref().unwrap().track.clone();
        let controller = reactsim::models::find("idm").unwrap().simulator().unwrap();
        let rollout = roll_out(vec![request(scenario, av, 0)], &controller, &Settings::default());
        let rollout = rollout.into_iter().next().unwrap().unwrap();
        no_contact(scenario, &rollout);
        let scores = scores(scenario, &rollout);
        assert!(violations(scenario, &scores).is_empty(), "{}", scenario.id);
        for id in ["aav-collision", "aa-collision", "offroad", "direction"] {
            let value = scores.value(id);
            assert!(value.is_none_or(|v| v == 0.0), "{}: {id} is {value:?}", scenario.id);
        }
        // Freezing is not rewarded: agents that are not in the way go on.
        assert!(
            scores.value("progress").is_none_or(|p| p > 0.5),
            "{}: {:?}",
            scenario.id,
            scores.value("progress")
        );
    }
}
