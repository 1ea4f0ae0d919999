//! Properties of every rollout of every baseline, whatever the scenario.

use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

use reactsim::models::learning::LEARNING_RANGES;
use reactsim::models::{Baseline, Card, MODELS, TASKS, idm, qp};
use reactsim::rollout::{Av, AvPolicy, LogAv, Protocol, Request, Rollout, Settings, roll_out};
use reactsim::scene::{AgentKind, CURRENT, DT, FRAMES, HISTORY, LoggedAgent, MapParts, Scenario};

use super::{INTERVALS, every_baseline, scenarios, settings};
use crate::scenes::{agent, bits, car, coasting, request, roll, scene, state, straight};

/// An AV that must not be used.
struct Unasked;

impl Av for Unasked {
    fn begin(&self, _: u32) -> Box<dyn AvPolicy> {
        panic!("the simulator moves the AV")
    }
}

fn realism(scenario: &Scenario) -> Request<'_> {
    Request { scenario, av: Some(Arc::new(Unasked)), rollout: 0 }
}

/// Returns the agents whose recorded states are replayed: all but an external AV by `log-replay`, none by
/// other simulators.
fn replayed(model: &Baseline, external_av: bool, scenario: &Scenario) -> Range<usize> {
    match model.id {
        "log-replay" => usize::from(external_av)..scenario.start.agents.len(),
        _ => 0..0,
    }
}

/// Checks the properties of a rollout of any simulator.
fn check(scenario: &Scenario, rollout: &Rollout, model: &Baseline, external_av: bool, what: &str) {
    let (replayed, fair) = (replayed(model, external_av, scenario), !model.oracle);
    let what = format!("{what}: {}", scenario.id);
    assert_eq!(rollout.tracks.len(), scenario.start.agents.len(), "{what}");
    for (i, track) in rollout.tracks.iter().enumerate() {
        assert_eq!(track.len(), FRAMES, "{what}: agent {i}");
        let history = bits(&[track[..HISTORY].to_vec(), scenario.start.history[i].clone()]);
        assert_eq!(history[0], history[1], "{what}: the history of agent {i} changed");
        for f in CURRENT..FRAMES - 1 {
            if let (Some(a), Some(b)) = (track[f], track[f + 1]) {
                let recorded = scenario.log_future.tracks[i][f + 1 - HISTORY].and_then(|s| s.velocity());
                let v = match recorded.filter(|_| replayed.contains(&i)) {
                    Some(v) => [v.x, v.y],
                    None => [(b.x - a.x) / DT, (b.y - a.y) / DT],
                };
                let exact = [b.vx, b.vy].map(f64::to_bits) == v.map(f64::to_bits);
                assert!(exact, "{what}: agent {i}: another velocity than by the rule after frame {f}");
                assert!(b.is_finite(), "{what}: agent {i}");
            }
            assert!(!fair || track[f + 1].is_some(), "{what}: agent {i} vanishes at frame {}", f + 1);
        }
    }
}

#[test]
fn rollouts_are_whole_and_agree_with_themselves() {
    for (model, controller) in every_baseline() {
        for (n, scenario) in scenarios(3).iter().enumerate() {
            for replan in INTERVALS {
                // Networks are slow: one scene is enough for a plan at every step.
                if model.needs_weights && replan == 1 && n > 0 {
                    continue;
                }
                let settings = settings(replan, true);
                let av = coasting(scenario);
                let done = roll(scenario, av.clone(), &controller, &settings);
                check(scenario, &done, model, true, model.id);
                for (track, given) in done.tracks[0][HISTORY..].iter().zip(&av) {
                    let s = track.unwrap();
                    assert_eq!(
                        (s.x, s.y, s.heading),
                        (given.x, given.y, given.heading),
                        "the AV is not as given"
                    );
                }
            }
        }
    }
}

#[test]
fn batches_orders_and_repetitions_change_no_bit() {
    let all = scenarios(3);
    for (model, controller) in every_baseline() {
        let settings = Settings::default();
        let run = |order: &[usize]| {
            let batch = order.iter().map(|&i| request(&all[i], coasting(&all[i]), 3)).collect();
            let done = roll_out(batch, &controller, &settings).into_iter();
            let mut done: Vec<_> = order.iter().copied().zip(done.map(|r| r.unwrap())).collect();
            done.sort_by_key(|d| d.0);
            done
        };
        let forwards: Vec<usize> = (0..all.len()).collect();
        let backwards: Vec<usize> = forwards.iter().rev().copied().collect();
        let whole = run(&forwards);
        let reversed = run(&backwards);
        for (k, (i, rollout)) in whole.iter().enumerate() {
            let alone = run(&[*i]).remove(0).1;
            for (other, how) in [(&reversed[k].1, "reversed"), (&alone, "alone")] {
                let same = bits(&rollout.tracks) == bits(&other.tracks) && rollout.outcomes == other.outcomes;
                assert!(same, "{}: {}: {how} gives another rollout", model.id, all[*i].id);
            }
        }
    }
}

#[test]
fn in_the_realism_protocol_the_simulator_moves_the_av() {
    for (model, controller) in every_baseline() {
        for scenario in &scenarios(2) {
            let settings = Settings { protocol: Protocol::Realism, ..Settings::default() };
            let done = roll_out(vec![realism(scenario)], &controller, &settings).remove(0).unwrap();
            check(scenario, &done, model, false, model.id);
            let (now, then) = (scenario.start.now(0), done.tracks[0][FRAMES - 1].unwrap());
            match model.id {
                "log-replay" => {
                    let logged = scenario.log_future.tracks[0][79].unwrap();
                    assert_eq!((then.x, then.y), (logged.x, logged.y), "{}", scenario.id);
                }
                "stop" => assert!(then.speed() < 1e-9 || now.speed() > 8.0 * 3.4, "{}", scenario.id),
                _ if now.speed() > 3.0 => {
                    assert!((then.position() - now.position()).norm() > 0.5, "{}: {}", model.id, scenario.id);
                }
                _ => {}
            }
        }
    }
}

/// Returns a car that is present in some frames only.
fn at_times(id: &str, x: f64, there: impl Fn(usize) -> bool) -> LoggedAgent {
    let mut logged = car(id, x, 0.0, 0.0, 8.0);
    for (f, state) in logged.track.iter_mut().enumerate() {
        *state = state.filter(|_| there(f));
    }
    logged
}

/// Returns scenes with something missing.
fn bare() -> Vec<Scenario> {
    let av = || car("av", 0.0, 0.0, 0.0, 9.0);
    let one = || vec![av(), car("one", -20.0, 0.0, 0.0, 10.0)];
    let kinds = || {
        let mut agents = vec![car("av", 0.0, 0.0, 0.0, 0.0)];
        agents.push(car("behind", -30.0, 0.0, 0.0, 10.0));
        agents.push(agent("walker", AgentKind::Pedestrian, state(10.0, -4.0, 1.5, 1.3)));
        agents.push(agent("rider", AgentKind::Cyclist, state(-12.0, -1.0, 0.0, 4.0)));
        agents.push(agent("cone", AgentKind::Other, state(25.0, 0.0, 0.0, 0.0)));
        agents
    };
    let mut blind = kinds();
    for state in blind.iter_mut().flat_map(|a| a.track.iter_mut().flatten()) {
        (state.vx, state.vy) = (f64::NAN, f64::NAN);
    }
    vec![
        scene("no agents", vec![av()], straight()),
        scene("no agents, no map", vec![av()], MapParts::default()),
        scene("one agent", one(), straight()),
        scene("one agent, no map", one(), MapParts::default()),
        scene("vanishing", vec![av(), at_times("gone", -20.0, |f| f <= CURRENT)], straight()),
        scene("a moment", vec![av(), at_times("moment", -20.0, |f| f == CURRENT)], straight()),
        scene("flicker", vec![av(), at_times("flicker", -20.0, |f| f % 3 == 1)], straight()),
        scene("coming", vec![av(), at_times("new", -20.0, |f| f >= CURRENT)], MapParts::default()),
        scene("all kinds, standing AV", kinds(), straight()),
        scene("all kinds, no map", kinds(), MapParts::default()),
        scene("velocities unknown", blind, straight()),
    ]
}

#[test]
fn bare_scenes_are_lawful() {
    for (model, controller) in every_baseline() {
        for scenario in &bare() {
            for (replan, lookahead) in INTERVALS.into_iter().flat_map(|r| [(r, true), (r, false)]) {
                // Networks are slow: the lookahead matters most if every step is planned, and that is done
                // where there are several agents.
                let few = scenario.start.agents.len() < 3;
                if model.needs_weights && if replan == 1 { few } else { !lookahead } {
                    continue;
                }
                let settings = settings(replan, lookahead);
                let mut av = coasting(scenario);
                av.iter_mut().filter(|s| !s.is_finite()).for_each(|s| *s = scenario.start.now(0));
                for state in roll_out(vec![request(scenario, av, 0)], &controller, &settings) {
                    let what = format!("{} every {replan}", model.id);
                    let done = state.unwrap_or_else(|e| panic!("{what}: {e}"));
                    check(scenario, &done, model, true, &what);
                }
                // Here the AV has no next state that could be shown.
                if !lookahead {
                    continue;
                }
                let settings = Settings { protocol: Protocol::Realism, ..settings };
                let done = roll_out(vec![realism(scenario)], &controller, &settings).remove(0);
                let what = format!("{} every {replan}, realism", model.id);
                let done = done.unwrap_or_else(|e| panic!("{what}: {e}"));
                check(scenario, &done, model, false, &what);
            }
        }
    }
}

/// Recorded velocities are measured; recorded positions need not agree with them.
#[test]
fn replayed_recordings_keep_their_velocities_and_nobody_else_does() {
    let mut agents = vec![car("av", 0.0, 0.0, 0.0, 9.0), car("one", -20.0, 0.0, 0.0, 10.0)];
    agents.push(car("partly unknown", -40.0, 0.0, 0.0, 10.0));
    for agent in &mut agents {
        agent.track[HISTORY..].iter_mut().flatten().for_each(|s| s.vy = 0.25);
    }
    for state in agents[2].track[HISTORY..].iter_mut().flatten() {
        state.vx = f64::NAN;
    }
    let scenario = scene("measured", agents, straight());
    let velocities = |id: &str, av: Arc<dyn Av>| -> Vec<[f64; 2]> {
        let controller = reactsim::models::find(id).unwrap().simulator().unwrap();
        let request = Request { scenario: &scenario, av: Some(av), rollout: 0 };
        let done = roll_out(vec![request], &controller, &Settings::default()).remove(0).unwrap();
        done.tracks.iter().map(|t| t[FRAMES - 1].map(|s| [s.vx.round(), s.vy]).unwrap()).collect()
    };
    let log = || Arc::new(LogAv::new(&scenario).unwrap());
    let driven = || request(&scenario, coasting(&scenario), 0).av.unwrap();
    assert_eq!(velocities("log-replay", log()), [[9.0, 0.25], [10.0, 0.25], [10.0, 0.0]]);
    // An AV that leaves the log is not a recording, nor is a simulator's plan.
    assert_eq!(velocities("log-replay", driven())[0], [9.0, 0.0]);
    assert_eq!(velocities("stop", log()), [[9.0, 0.25], [0.0, 0.0], [0.0, 0.0]]);
}

/// Texts of the TOML files of `models`, except manifests of crates.
#[derive(Default)]
struct ModelFiles {
    cards: BTreeSet<String>,
    ranges: BTreeSet<String>,
    recipes: BTreeSet<String>,
}

impl ModelFiles {
    /// Adds the files below a folder.
    fn add(&mut self, folder: &Path) {
        for path in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
            if path.is_dir() {
                self.add(&path);
            } else if path.extension().is_some_and(|e| e == "toml") && !path.ends_with("Cargo.toml") {
                let files = if path.ends_with("ranges.toml") || folder.ends_with("ranges") {
                    &mut self.ranges
                } else if folder.ends_with("recipes") {
                    &mut self.recipes
                } else {
                    &mut self.cards
                };
                files.insert(std::fs::read_to_string(path).unwrap());
            }
        }
    }
}

#[test]
fn cards_are_read_and_each_is_that_of_one_baseline() {
    let home = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let mut files = ModelFiles::default();
    files.add(&home);
    // The cards of the baselines, and that of the stage behind them.
    let of_models: BTreeSet<String> =
        MODELS.iter().map(|m| m.card).chain([qp::CARD]).map(str::to_owned).collect();
    assert_eq!(files.cards, of_models);
    assert_eq!(of_models.len(), MODELS.len() + 1);
    let used = MODELS.iter().map(|m| m.ranges).chain(TASKS.iter().map(|task| task.ranges));
    let used = used.chain([qp::RANGES, LEARNING_RANGES]).filter(|text| !text.is_empty());
    // `idm@styles` has the ranges of `idm`, and a file with the others.
    let own = |text: &'static str| text.strip_prefix(idm::ENTRY.ranges).filter(|rest| !rest.is_empty());
    assert_eq!(files.ranges, used.map(|text| own(text).unwrap_or(text).to_owned()).collect());
    let recipes = TASKS.iter().flat_map(|task| task.recipes).map(|recipe| recipe.text.to_owned());
    assert_eq!(files.recipes, recipes.collect());
    for (i, model) in MODELS.iter().enumerate() {
        assert!(MODELS[..i].iter().all(|m| m.id != model.id), "{} twice", model.id);
        // A baseline with a folder of its own has the name of the folder.
        let folders = [home.clone(), home.join("baseline/non_reactive")];
        let cards = folders.map(|folder| folder.join(model.id.replace('-', "_")).join("card.toml"));
        for own in cards.into_iter().filter(|path| path.exists()) {
            assert_eq!(std::fs::read_to_string(own).unwrap(), model.card, "{}", model.id);
        }
        let card = Card::read(model.id, model.card).unwrap();
        for text in [&card.title, &card.summary, &card.controls] {
            assert!(!text.trim().is_empty(), "{}: {card:?}", model.id);
        }
        assert!(!card.sources.is_empty(), "{}: no sources", model.id);
        if model.is_complete() {
            assert_eq!(model.simulator().unwrap().is_oracle(), model.oracle, "{}", model.id);
        }
    }
}
