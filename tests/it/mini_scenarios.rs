//! The hand-made scenarios serve their purpose.

use reactsim::geometry::{rounded_distance, wrap};
use reactsim::rollout::Settings;
use reactsim::scene::{AgentKind, AgentState, CURRENT, DT, Frame, HISTORY, Scenario};

use crate::scenes::{mini, roll_with, scores};

/// Returns the first frame from `first` on at which two agents of the tracks overlap.
fn overlap(scenario: &Scenario, tracks: &[Vec<Frame>], i: usize, j: usize, first: usize) -> Option<usize> {
    let agents = &scenario.start.agents;
    (first..tracks[i].len()).find(|&f| match (tracks[i][f], tracks[j][f]) {
        (Some(a), Some(b)) => rounded_distance(&a.footprint(&agents[i]), &b.footprint(&agents[j]), 0.7) < 0.0,
        _ => false,
    })
}

fn logged(scenario: &Scenario) -> Vec<Vec<Frame>> {
    (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect()
}

#[test]
fn there_are_twelve_with_people_and_bicycles() {
    let all = mini();
    assert_eq!(all.len(), 12);
    for scenario in &all {
        assert_eq!(scenario.source, "hand-made");
        assert!(scenario.repairs.is_empty(), "{}: {:?}", scenario.id, scenario.repairs);
        let count = |kind| scenario.start.agents.iter().skip(1).filter(|a| a.kind == kind).count();
        assert!(count(AgentKind::Pedestrian) > 0 && count(AgentKind::Cyclist) > 0, "{}", scenario.id);
        assert!((3..=8).contains(&(scenario.start.agents.len() - 1)), "{}", scenario.id);
        assert!(scenario.deviation.as_ref().is_some_and(|d| d.category.is_some()), "{}", scenario.id);
    }
}

#[test]
fn the_log_is_free_of_collisions_and_on_the_road() {
    for scenario in mini() {
        let (tracks, road) = (logged(&scenario), scenario.start.road());
        for i in 0..tracks.len() {
            for j in i + 1..tracks.len() {
                let hit = overlap(&scenario, &tracks, i, j, 0);
                assert_eq!(hit, None, "{}: agents {i} and {j} overlap in the log", scenario.id);
            }
            if scenario.start.agents[i].kind != AgentKind::Vehicle {
                continue;
            }
            let (mut start, mut hits) = (None, Vec::new());
            for state in tracks[i].iter().flatten() {
                assert_eq!(road.drivable(state.position(), &mut start), Some(true), "{}: {i}", scenario.id);
                road.lanes_at(state.position(), &mut hits);
                let along = |lane: usize, segment: usize| {
                    wrap(state.heading - road.lane(lane).baseline.heading(segment)).abs() < 0.6
                };
                let clean = state.speed() < 0.5 || hits.iter().any(|h| along(h.lane, h.projection.segment));
                assert!(clean, "{}: agent {i} drives along no lane", scenario.id);
            }
        }
    }
}

#[test]
fn log_replay_runs_into_the_deviated_av() {
    for scenario in mini() {
        let mut tracks = logged(&scenario);
        let track = &scenario.deviation.as_ref().unwrap().track;
        let mut before: AgentState = scenario.start.now(0);
        let mut v0 = before.speed();
        for (k, state) in track.iter().enumerate() {
            let v1 = (state.position() - before.position()).norm() / DT;
            let bend = wrap(state.heading - before.heading).abs() / (0.5 * (v0 + v1) * DT);
            assert!((v1 - v0).abs() / DT <= 6.0, "{}: step {}", scenario.id, k + 1);
            assert!(v0 < 0.6 || v1 < 0.6 || bend <= 0.3, "{}: step {}", scenario.id, k + 1);
            tracks[0][HISTORY + k] = Some(*state);
            (before, v0) = (*state, v1);
        }
        let hits: Vec<usize> =
            (1..tracks.len()).filter_map(|i| overlap(&scenario, &tracks, 0, i, CURRENT)).collect();
        // Not at once: there must be time to react.
        assert!(!hits.is_empty() && hits.iter().all(|f| *f > CURRENT + 25), "{}: {hits:?}", scenario.id);
    }
}

#[test]
fn the_log_is_faultless_and_others_are_to_blame_for_hitting_the_deviated_av() {
    for scenario in mini() {
        let value = |av: Vec<AgentState>, id: &str| {
            let rollout = roll_with("log-replay", &scenario, av, &Settings::default(), 0);
            scores(&scenario, &rollout).value(id).unwrap_or(0.0)
        };
        let logged: Vec<AgentState> = scenario.log_future.tracks[0].iter().map(|s| s.unwrap()).collect();
        for id in ["aav-collision", "aa-collision", "offroad", "direction", "acceleration", "curvature"] {
            assert_eq!(value(logged.clone(), id), 0.0, "{}: {id}", scenario.id);
        }
        let deviated = scenario.deviation.as_ref().unwrap().track.clone();
        assert!(value(deviated, "aav-collision") >= 1.0, "{}", scenario.id);
    }
}
