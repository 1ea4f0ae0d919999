//! Replay of the log by tokens.

use std::sync::Arc;

use reactsim::models::ntp::reactive::Policy;
use reactsim::models::ntp::tokens::{Kinematic, Vocabulary};
use reactsim::models::{WeightsFile, find};
use reactsim::rollout::{Controller, LogAv, Request, Settings, roll_out};
use reactsim::scene::{AgentKind, CURRENT, FRAMES, Frame, HISTORY, Scenario};

use crate::scenes::{car, mini, scene, straight};
use crate::small_scenarios::scenario;

/// Returns the tracks of a scenario as `token-replay` drives it with the kinematic tokens.
fn replayed(scenario: &Scenario) -> Vec<Vec<Frame>> {
    let bytes = Kinematic::default().build().unwrap().write().unwrap();
    let baseline = find("token-replay").unwrap();
    let mut setup = baseline.setup().unwrap();
    setup.weights = Some(WeightsFile::new("kinematic.safetensors", bytes));
    let controller: Controller = (baseline.make)(setup).unwrap();
    let av = Arc::new(LogAv::new(scenario).unwrap());
    let request = Request { scenario, av: Some(av), rollout: 0 };
    roll_out(vec![request], &controller, &Settings::default()).remove(0).unwrap().tracks
}

#[test]
fn agents_stay_near_their_log_and_parked_ones_where_they_are() {
    let (mut vehicles, mut parked) = (0, 0);
    let cars =
        [(0.0, 9.0), (-20.0, 10.0), (-60.0, 0.0)].map(|(x, v)| car(&format!("at {x}"), x, 0.0, 0.0, v));
    for scenario in mini().into_iter().chain([scene("cars", cars.into(), straight())]) {
        let tracks = replayed(&scenario);
        for (agent, track) in tracks.iter().enumerate().skip(1) {
            if scenario.start.agents[agent].kind != AgentKind::Vehicle {
                continue;
            }
            vehicles += 1;
            let logged = scenario.logged(agent);
            let now = logged[CURRENT].unwrap();
            let stands = logged[CURRENT..].iter().flatten().all(|s| s.position() == now.position());
            parked += usize::from(stands);
            for (frame, state) in track.iter().enumerate().skip(HISTORY) {
                let (Some(state), Some(log)) = (state, logged[frame]) else { continue };
                let away = (state.position() - log.position()).norm();
                assert!(away < 1.0, "{}: agent {agent}, frame {frame}: {away} m", scenario.id);
                assert!(
                    !stands || away < 1e-9,
                    "{}: agent {agent} is parked but moved {away} m",
                    scenario.id
                );
            }
        }
    }
    assert!(vehicles > 10 && parked > 0, "{vehicles} vehicles, {parked} parked");
}

#[test]
fn agents_are_present_for_whole_half_seconds() {
    let mut scenario = scenario(0);
    let agent = (1..scenario.start.agents.len())
        .find(|a| (CURRENT..FRAMES).all(|f| scenario.logged_at(*a, f).is_some()))
        .unwrap();
    // The recording ends at frame 43.
    scenario.log_future.tracks[agent][44 - HISTORY..].fill(None);
    let present: Vec<bool> = replayed(&scenario)[agent].iter().map(Option::is_some).collect();
    assert!(present[CURRENT..=40].iter().all(|p| *p) && !present[41..].iter().any(|p| *p));
}

#[test]
fn vocabularies_are_read_from_the_weights_of_networks() {
    let weights = crate::ntp_reactive::untrained();
    let policy = Policy::read(&weights, &reactsim::models::nn::device()).unwrap();
    assert_eq!(Vocabulary::read(&weights).unwrap(), policy.vocabulary);
    assert_eq!(Vocabulary::read(&policy.vocabulary.write().unwrap()).unwrap(), policy.vocabulary);
    assert!(Vocabulary::read(&weights[..100]).is_err());
}
