//! Agents of the log that enter a rollout, with every baseline.

use std::collections::BTreeSet;
use std::sync::Arc;

use reactsim::metrics::{Case, Options, score_case};
use reactsim::models::find;
use reactsim::planning::from_scene::rollout_objects;
use reactsim::rollout::{ENTERED, Entering, LogAv, Request, Rollout, Settings, roll_out};
use reactsim::scene::{AgentKind, CURRENT, FRAMES, Frame, LoggedAgent, Scenario};

use super::{every_baseline, settings};
use crate::scenes::{agent, bits, car, scene, state, straight};

/// Returns an agent that the log shows from a frame on.
fn from(first: usize, mut logged: LoggedAgent) -> LoggedAgent {
    logged.track[..first].fill(None);
    logged
}

/// A road on which a car follows the AV; another car and a pedestrian appear later, and an object of the
/// static context.
pub(crate) fn street(id: &str) -> Scenario {
    let agents = vec![
        car("av", 0.0, 0.0, 0.0, 8.0),
        car("behind", -20.0, 0.0, 0.0, 8.0),
        from(33, car("late", -60.0, 0.0, 0.0, 9.0)),
        from(58, agent("walker", AgentKind::Pedestrian, state(60.0, 20.0, 1.0, 1.2))),
        from(40, agent("cone", AgentKind::Other, state(90.0, 12.0, 0.0, 0.0))),
    ];
    scene(id, agents, straight())
}

pub(crate) fn settings_of(entering: Entering) -> Settings {
    Settings { entering, ..settings(7, true) }
}

pub(crate) fn request(scenario: &Scenario) -> Request<'_> {
    Request { scenario, av: Some(Arc::new(LogAv::new(scenario).unwrap())), rollout: 0 }
}

fn pose(frame: Frame) -> [f64; 3] {
    let state = frame.unwrap();
    [state.x, state.y, state.heading]
}

#[test]
fn every_simulator_moves_agents_that_enter() {
    let (street, other) = (street("street"), street("other"));
    for (model, controller) in every_baseline() {
        let entering = settings_of(Entering::Log);
        let single = |scenario| roll_out(vec![request(scenario)], &controller, &entering).remove(0).unwrap();
        let done: Rollout = single(&street);
        let frames: Vec<usize> = done.entered.iter().map(|agent| agent.frame).collect();
        assert_eq!((frames, done.outcomes[ENTERED]), (vec![33, 58], 2), "{}", model.id);
        assert_eq!(done.tracks.len(), 4, "{}", model.id);
        for (entered, track) in done.entered.iter().zip(&done.tracks[2..]) {
            let log = &street.unselected[entered.logged];
            assert_eq!(track.len(), FRAMES, "{}", model.id);
            assert!(track[..entered.frame].iter().all(Option::is_none), "{}", model.id);
            assert_eq!(pose(track[entered.frame]), pose(log.track[entered.frame]), "{}", model.id);
            for (frame, state) in track.iter().enumerate().skip(entered.frame) {
                assert!(state.is_some_and(|s| s.is_finite()), "{}: frame {frame}", model.id);
                if model.oracle {
                    assert_eq!(pose(*state), pose(log.track[frame]), "{}", model.id);
                }
            }
        }
        // Agents that are there go on as without the others until these enter.
        let off =
            roll_out(vec![request(&street)], &controller, &settings_of(Entering::Off)).remove(0).unwrap();
        let begin = |rollout: &Rollout| bits(&[rollout.tracks[1][..33].to_vec()]);
        assert_eq!(begin(&done), begin(&off), "{}", model.id);
        assert_eq!((off.tracks.len(), off.entered.len()), (2, 0), "{}", model.id);
        // The rest of a batch has no effect.
        let batch = roll_out(vec![request(&other), request(&street)], &controller, &entering);
        let [first, second]: [Rollout; 2] =
            batch.into_iter().map(Result::unwrap).collect::<Vec<_>>().try_into().unwrap();
        assert_eq!(bits(&second.tracks), bits(&done.tracks), "{}", model.id);
        assert_eq!(bits(&first.tracks), bits(&single(&other).tracks), "{}", model.id);
    }
}

#[test]
fn what_the_log_shows_of_an_agent_after_it_entered_is_withheld() {
    let street = street("street");
    let mut other = street.clone();
    for logged in &mut other.unselected {
        let Some(first) = logged.track.iter().position(Option::is_some) else { continue };
        logged.track[first + 1..].iter_mut().flatten().for_each(|state| state.y += 0.5);
    }
    for (model, controller) in every_baseline().filter(|(model, _)| !model.oracle) {
        let entering = settings_of(Entering::Log);
        let tracks = |scenario| {
            bits(&roll_out(vec![request(scenario)], &controller, &entering).remove(0).unwrap().tracks)
        };
        assert_eq!(tracks(&street), tracks(&other), "{}", model.id);
    }
}

#[test]
fn nothing_changes_if_no_agent_appears() {
    let still =
        scene("still", vec![car("av", 0.0, 0.0, 0.0, 8.0), car("b", -20.0, 0.0, 0.0, 8.0)], straight());
    for (model, controller) in every_baseline() {
        let run = |entering| {
            let settings = settings_of(entering);
            bits(&roll_out(vec![request(&still)], &controller, &settings).remove(0).unwrap().tracks)
        };
        assert_eq!(run(Entering::Log), run(Entering::Off), "{}", model.id);
    }
}

#[test]
fn agents_that_enter_are_judged_and_obstacles_come_and_go() {
    let mut cone = agent("cone", AgentKind::Other, state(30.0, 0.0, 0.0, 0.0));
    cone.track[CURRENT + 5..].fill(None);
    let agents = vec![
        car("av", 0.0, 0.0, 0.0, 8.0),
        from(CURRENT + 10, car("late", 40.0, 0.0, 0.0, 0.0)),
        cone,
        from(CURRENT + 20, agent("later cone", AgentKind::Other, state(70.0, 9.0, 0.0, 0.0))),
    ];
    let scenario = scene("judged", agents, straight());
    let stop = find("stop").unwrap().simulator().unwrap();
    let done = roll_out(vec![request(&scenario)], &stop, &settings_of(Entering::Log)).remove(0).unwrap();
    let entered: Vec<usize> = done.entered.iter().map(|agent| agent.logged).collect();
    let scene = scenario.with_entered(&entered);
    let scores = score_case(&Case::of_rollout(&scene, &done.tracks, Options::default()));
    let hits: Vec<_> = scores.events.iter().filter(|e| e.metric == "aav-collision").collect();
    // The AV drives 8 m/s: its front is 40 - 4.6 m ahead after 4.4 s, about step 44.
    assert_eq!(hits.len(), 1);
    assert!(hits[0].agent == "late" && (42..=46).contains(&hits[0].step), "{:?}", hits[0]);

    let mut labels = BTreeSet::new();
    let objects = rollout_objects(&scene, &done.tracks, &mut labels);
    let at = |step: usize| objects[step].iter().map(|object| object.id.to_string()).collect::<Vec<_>>();
    assert_eq!(at(4), ["obstacle:0"]);
    assert_eq!(at(5), [""; 0]);
    assert_eq!(at(10), ["late"]);
    assert_eq!(at(20), ["late", "obstacle:1"]);
}
