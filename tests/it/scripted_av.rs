//! Scripted AVs on real logs.

use reactsim::formats;
use reactsim::geometry::{Polyline, Vec2, wrap};
use reactsim::rollout::{Script, ScriptedAv};
use reactsim::scene::{AgentState, CURRENT, DT, Scenario};

use crate::program::words;

fn plan(scenario: &Scenario, script: &str) -> Vec<AgentState> {
    let script: Script = script.parse().unwrap();
    ScriptedAv::new(scenario, script).unwrap_or_else(|e| panic!("{}: {e}", scenario.id)).track().to_vec()
}

/// Returns the steps at which the acceleration or the curvature, by sections 7 and 8 of the metrics, exceeds
/// 6 m/s² or 0.3 1/m.
fn beyond_limits(now: &AgentState, track: &[AgentState]) -> Vec<String> {
    let (mut before, mut v0, mut found) = (*now, now.speed(), Vec::new());
    for (k, state) in track.iter().enumerate() {
        let v1 = (state.position() - before.position()).norm() / DT;
        let a = (v1 - v0) / DT;
        let bend = wrap(state.heading - before.heading) / (0.5 * (v0 + v1) * DT);
        if a.abs() > 6.001 {
            found.push(format!("step {}: acceleration {a:.3}", k + 1));
        }
        if v0 >= 0.6 && v1 >= 0.6 && bend.abs() > 0.301 {
            found.push(format!("step {}: curvature {bend:.3}", k + 1));
        }
        (before, v0) = (*state, v1);
    }
    found
}

/// Returns the faults of scripted AVs on one real log, in words.
fn check(scenario: &Scenario) -> Vec<String> {
    let mut found = Vec::new();
    let now = scenario.start.now(0);
    let logged: Vec<AgentState> = scenario.logged(0)[CURRENT..].iter().copied().flatten().collect();
    let scripts = "constant-velocity brake:1 brake:4 brake:6 retime:0.5 retime:1 retime:1.6 retime:3 shift:2 \
                   shift:-2 shift:5";
    for script in words(scripts) {
        let track = plan(scenario, script);
        found.extend(beyond_limits(&now, &track).into_iter().map(|what| format!("{script}: {what}")));
    }
    // A few recorded AVs jump.
    let steps: Vec<f64> = logged.windows(2).map(|w| (w[1].position() - w[0].position()).norm()).collect();
    let jumps = steps.windows(2).any(|s| (s[1] - s[0]).abs() > 0.2);
    let worst = plan(scenario, "retime:1")
        .iter()
        .zip(&logged[1..])
        .map(|(a, b)| (a.position() - b.position()).norm())
        .fold(0.0, f64::max);
    if worst > 0.5 && !jumps {
        found.push(format!("retime:1 is {worst:.2} m away from the log"));
    }
    let brake = plan(scenario, "brake:4");
    if let Some(halt) = brake.iter().position(|s| s.speed() == 0.0) {
        let time = now.speed() / 4.0;
        if (halt as f64 * DT - time).abs() > 0.3 {
            found.push(format!("brake:4 halts after {halt} steps instead of {time:.2} s"));
        }
        if brake[halt..].iter().any(|s| s != &brake[halt]) {
            found.push("brake:4 moves again".into());
        }
    }
    let points: Vec<Vec2> = logged.iter().map(AgentState::position).collect();
    if let Ok(path) = Polyline::new(&points)
        && path.length() > 25.0
    {
        let track = plan(scenario, "shift:2");
        // The last position that is still next to the logged path.
        let at = track.iter().map(|s| path.project(s.position())).rfind(|p| p.s < path.length() - 1.0);
        if let Some(at) = at
            && (at.offset - 2.0).abs() > 0.2
        {
            found.push(format!("shift:2 ends {:.2} m beside the log", at.offset));
        }
    }
    found
}

#[test]
fn real_logs_give_feasible_scripts() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    let (mut scenarios, mut failures) = (0, Vec::new());
    for scenario in formats::open(&folder).unwrap() {
        let scenario = scenario.unwrap();
        let absent = scenario.log_future.tracks[0].iter().any(Option::is_none);
        if absent {
            continue;
        }
        scenarios += 1;
        failures.extend(check(&scenario).into_iter().map(|what| format!("{}: {what}", scenario.id)));
    }
    assert!(scenarios > 100, "{scenarios} scenarios");
    assert!(failures.is_empty(), "{} of {scenarios}:\n{}", failures.len(), failures.join("\n"));
}
