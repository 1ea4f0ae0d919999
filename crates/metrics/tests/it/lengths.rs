//! Scenarios of other lengths than the benchmark are judged over all their steps.

use reactsim_metrics::{Case, Metrics, Options, Score, Scores};
use reactsim_scene::{Agent, AgentKind, AgentState, DT, Frame, Length, LoggedAgent, Scenario, ScenarioParts};

/// Lengths of scenarios: history and steps.
const LENGTHS: [(usize, usize); 7] =
    [(11, 80), (11, 150), (11, 60), (11, 600), (2, 60), (21, 150), (100, 20)];

/// Returns the track along the x axis that is at `x` at the current frame.
fn straight(length: Length, x: f64, y: f64, speed: f64) -> Vec<Frame> {
    let state = |f: usize| {
        let t = DT * (f as f64 - length.current() as f64);
        Some(AgentState { x: x + speed * t, y, heading: 0.0, vx: speed, vy: 0.0 })
    };
    (0..length.frames()).map(state).collect()
}

/// A standing AV, and a car beside it that drives past.
fn scenario(length: Length) -> Scenario {
    let car = |id: &str, track| LoggedAgent {
        agent: Agent { id: id.into(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
        track,
        heights: Vec::new(),
    };
    let agents =
        vec![car("av", straight(length, 0.0, 0.0, 0.0)), car("car", straight(length, -50.0, 10.0, 5.0))];
    Scenario::assemble(ScenarioParts { id: "two".into(), length, agents, ..ScenarioParts::default() })
        .unwrap()
}

fn judged(scenario: &Scenario, tracks: &[Vec<Frame>]) -> Scores {
    Metrics::default().score_case(&Case::of_rollout(scenario, tracks, Options::default()))
}

#[test]
fn all_steps_count_and_no_more() {
    for (history, future) in LENGTHS {
        let length = Length { history, future };
        let scenario = scenario(length);
        let case = |tracks: &[Vec<Frame>]| judged(&scenario, tracks);
        let logged: Vec<Vec<Frame>> = (0..2).map(|i| scenario.logged(i)).collect();
        let replay = case(&logged);
        assert_eq!(replay.score("ade"), Some(Score::Value(0.0)), "{length}");
        // Every step has a transition from the frame before.
        let steps = future as u64;
        assert_eq!(replay.score("acceleration"), Some(Score::Rate { hits: 0, valid: steps }), "{length}");
        // A car that is 3 m beside its log at each step.
        let mut beside = logged.clone();
        beside[1][history..].iter_mut().flatten().for_each(|state| state.y += 3.0);
        let Some(Score::Value(ade)) = case(&beside).score("ade") else { panic!("no ADE") };
        assert!((ade - 3.0).abs() < 1e-9, "{length}: {ade}");
        // Only the last step is a contact, in front of the car that moves.
        let mut late = logged.clone();
        late[1][length.frames() - 1] =
            late[0][length.frames() - 1].map(|av| AgentState { x: av.x - 4.0, vx: 5.0, ..av });
        let found = case(&late);
        assert_eq!(found.score("aav-collision"), Some(Score::Count(1)), "{length}");
        let event = found.events.iter().find(|event| event.metric == "aav-collision").unwrap();
        assert_eq!((event.step, event.last_step), (future, future), "{length}");
        // A contact before the current frame is not judged.
        let mut early = logged.clone();
        early[1][0] = late[1][length.frames() - 1];
        assert_eq!(case(&early).score("aav-collision"), Some(Score::Count(0)), "{length}");
    }
}

#[test]
fn progress_is_of_the_whole_path() {
    for (history, future) in LENGTHS {
        let length = Length { history, future };
        let scenario = scenario(length);
        let logged: Vec<Vec<Frame>> = (0..2).map(|i| scenario.logged(i)).collect();
        // It stops half-way.
        let mut halted = logged.clone();
        let middle = halted[1][length.current() + future / 2];
        halted[1][length.current() + future / 2..].fill(middle);
        let Some(Score::Mean { sum, n: 1 }) = judged(&scenario, &halted).score("progress") else {
            panic!("{length}: no progress")
        };
        let expected = (future / 2) as f64 / future as f64;
        assert!((sum - expected).abs() < 1e-9, "{length}: {sum}");
    }
}

#[test]
fn several_rollouts_are_compared_over_all_steps() {
    for (history, future) in LENGTHS {
        let length = Length { history, future };
        let scenario = scenario(length);
        let logged: Vec<Vec<Frame>> = (0..2).map(|i| scenario.logged(i)).collect();
        let beside = |metres: f64| {
            let mut tracks = logged.clone();
            tracks[1][history..].iter_mut().flatten().for_each(|state| state.y += metres);
            tracks
        };
        let rollouts = [beside(2.0), beside(-1.0)];
        let all: Vec<&[Vec<Frame>]> = rollouts.iter().map(Vec::as_slice).collect();
        let case = Case::of_rollout(&scenario, &rollouts[0], Options::default());
        let scores = Metrics::default().score_rollouts(case, &all);
        let displacement = scores.displacement.unwrap();
        assert!((displacement.ade - 1.5).abs() < 1e-9, "{length}: {displacement:?}");
        assert!((displacement.min_ade - 1.0).abs() < 1e-9, "{length}: {displacement:?}");
        // Defined by the Sim Agents challenge, for 80 steps.
        assert_eq!(scores.likelihood.is_some(), future == 80, "{length}");
    }
}
