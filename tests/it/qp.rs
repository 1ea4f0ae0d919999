//! The stage behind simulators: limits on whole rollouts, other agents, threads, names.

use std::sync::Arc;

use rand_chacha::rand_core::Rng;
use reactsim::evaluation::{Adjustments, EvaluationError, PlannedSimulator, weights_file};
use reactsim::formats;
use reactsim::geometry::{Vec2, direction, wrap};
use reactsim::models::{self, ModelError, qp::Smoothing};
use reactsim::rollout::{
    Av, Controller, DeviatedAv, PlanError, Planning, Request, Rollout, ScriptedAv, Settings, SingleEpisode,
    Stream, roll_out,
};
use reactsim::scene::{AgentKind, AgentState, CURRENT, DT, Scenario, Start};

use crate::scenes::{
    agent, bystander, car, contact, future, lane, line, mini, request, scene, state, straight,
};

fn behind(smoothing: Smoothing, id: &str) -> Controller {
    let baseline = models::find(id).unwrap();
    smoothing.behind(baseline.id, baseline.simulator().unwrap()).unwrap()
}

fn run(controller: &Controller, scenario: &Scenario) -> Rollout {
    let av: Arc<dyn Av> = match &scenario.deviation {
        Some(d) => Arc::new(DeviatedAv::new(scenario, d.track.clone()).unwrap()),
        None => Arc::new(ScriptedAv::new(scenario, "brake:4".parse().unwrap()).unwrap()),
    };
    let request = Request { scenario, av: Some(av), rollout: 0 };
    roll_out(vec![request], controller, &Settings::default()).remove(0).unwrap()
}

/// Checks every transition of every vehicle, from positions and headings alone.
pub(crate) fn check_limits(scenario: &Scenario, rollout: &Rollout) {
    for (slot, agent) in scenario.start.agents.iter().enumerate().skip(1) {
        if agent.kind != AgentKind::Vehicle {
            continue;
        }
        let states: Vec<AgentState> = rollout.tracks[slot][CURRENT..].iter().flatten().copied().collect();
        let mut v0 = states[0].velocity().map(|v| v.norm());
        for pair in states.windows(2) {
            let v1 = (pair[1].position() - pair[0].position()).norm() / DT;
            if let Some(v0) = v0 {
                let a = (v1 - v0) / DT;
                assert!(a.abs() <= 5.5 + 1e-6, "{}: {}: {a} m/s2", scenario.id, agent.id);
                if v0 >= 0.6 && v1 >= 0.6 {
                    let turn = wrap(pair[1].heading - pair[0].heading);
                    let c = turn / (0.5 * (v0 + v1) * DT);
                    assert!(c.abs() <= 0.27 + 1e-6, "{}: {}: {c} 1/m", scenario.id, agent.id);
                }
            }
            v0 = Some(v1);
        }
    }
}

/// Plans arbitrary motion.
struct Wild;

impl SingleEpisode for Wild {
    type Memory = ();

    fn id(&self) -> &'static str {
        "wild"
    }

    fn begin(&self, _: &Start, _: &mut Stream) {}

    fn plan_one(&self, (): &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for agent in 0..episode.plan.agents() {
            let Some(mut state) = episode.seen.state(agent) else { continue };
            for k in 0..episode.plan.steps() {
                let mut draw = || f64::from(episode.stream.next_u32()) / f64::from(u32::MAX) - 0.3;
                let step = direction(state.heading) * (3.0 * draw()) + Vec2::new(draw(), draw());
                state.x += step.x;
                state.y += step.y;
                state.heading += 0.3 * draw();
                episode.plan.set(agent, k, Some(state));
            }
        }
        Ok(())
    }
}

#[test]
fn limits_hold_in_every_rollout_whatever_is_wished() {
    for smoothing in Smoothing::ALL {
        let wild = smoothing.behind("wild", Controller::Fair(Box::new(Wild))).unwrap();
        let keeps = behind(smoothing, "constant-velocity");
        for scenario in mini() {
            for controller in [&wild, &keeps] {
                let rollout = run(controller, &scenario);
                check_limits(&scenario, &rollout);
                let plans: u64 = rollout
                    .outcomes
                    .iter()
                    .filter(|(n, _)| !n.contains("solves") && !n.contains("iter"))
                    .map(|o| o.1)
                    .sum();
                let vehicles =
                    scenario.start.agents[1..].iter().filter(|a| a.kind == AgentKind::Vehicle).count();
                assert_eq!(plans, 16 * vehicles as u64, "{:?}", rollout.outcomes);
                assert_eq!(rollout.outcomes.get("qp-failed-solves"), None, "{:?}", rollout.outcomes);
            }
        }
    }
}

#[test]
fn one_plan_for_all_eight_seconds_ends_in_a_halt_within_limits() {
    let settings = Settings { replan: "80steps".parse().unwrap(), ..Settings::default() };
    let controller = behind(Smoothing::Full, "constant-velocity");
    for scenario in mini() {
        let av = Arc::new(ScriptedAv::new(&scenario, "brake:4".parse().unwrap()).unwrap());
        let requests = vec![Request { scenario: &scenario, av: Some(av), rollout: 0 }];
        let rollout = roll_out(requests, &controller, &settings).remove(0).unwrap();
        check_limits(&scenario, &rollout);
        for (slot, agent) in scenario.start.agents.iter().enumerate().skip(1) {
            let (before, last) =
                (rollout.tracks[slot][CURRENT + 50].unwrap(), rollout.tracks[slot][90].unwrap());
            if agent.kind == AgentKind::Vehicle {
                let speed = |s: &AgentState| s.velocity().unwrap().norm();
                assert!(speed(&last) <= (speed(&before) - 8.9).max(0.0) + 1e-6, "{}", agent.id);
            }
        }
    }
}

#[test]
fn limits_hold_on_recorded_scenes() {
    let Some(folder) = crate::shared("data/womd/train") else { return };
    let controller = behind(Smoothing::Full, "constant-velocity");
    let mut count = 0;
    for scenario in formats::open(&folder).unwrap().map(Result::unwrap).take(6) {
        check_limits(&scenario, &run(&controller, &scenario));
        count += 1;
    }
    assert_eq!(count, 6);
}

#[test]
fn people_and_bicycles_move_as_planned_where_nothing_stands() {
    let plain = models::find("constant-velocity").unwrap().simulator().unwrap();
    let smoothed = behind(Smoothing::WithoutOthers, "constant-velocity");
    for scenario in mini() {
        let (a, b) = (run(&plain, &scenario), run(&smoothed, &scenario));
        for (slot, agent) in scenario.start.agents.iter().enumerate() {
            if agent.kind != AgentKind::Vehicle {
                assert_eq!(a.tracks[slot], b.tracks[slot], "{}: {}", scenario.id, agent.id);
            }
        }
    }
}

#[test]
fn people_walk_round_parked_cars() {
    let walker = agent("walker", AgentKind::Pedestrian, state(20.0, 20.2, 0.0, 1.4));
    let agents = vec![bystander(), car("parked", 26.0, 20.0, 0.0, 0.0), walker];
    let scenario = scene("parked", agents, straight());
    let walks = || Controller::Fair(Box::new(Goes(Vec2::new(1.4, 0.0))));
    let plain = walks();
    let alone = Smoothing::WithoutOthers.behind("goes", walks()).unwrap();
    let full = Smoothing::Full.behind("goes", walks()).unwrap();
    let meets = |controller: &Controller| contact(&scenario, &run(controller, &scenario)).is_some();
    assert!(meets(&plain) && meets(&alone) && !meets(&full));
    let walked = future(&scenario, &run(&full, &scenario), "walker");
    assert!(walked[80].x > 28.0, "{:?}", walked[80]);
}

/// Plans this velocity for every agent that moves, whatever its heading.
struct Goes(Vec2);

impl SingleEpisode for Goes {
    type Memory = ();

    fn id(&self) -> &'static str {
        "goes"
    }

    fn begin(&self, _: &Start, _: &mut Stream) {}

    fn plan_one(&self, (): &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for agent in 1..episode.plan.agents() {
            let Some(mut state) = episode.seen.state(agent) else { continue };
            let moves = state.vx != 0.0 || state.vy != 0.0;
            for k in 0..episode.plan.steps() {
                if moves {
                    (state.x, state.y) = (state.x + self.0.x * DT, state.y + self.0.y * DT);
                }
                episode.plan.set(agent, k, Some(state));
            }
        }
        Ok(())
    }
}

#[test]
fn nobody_is_led_onto_the_lanes_of_those_who_come() {
    let two_ways = |against: bool| {
        let (from, to) = ((-150.0, 3.5), (350.0, 3.5));
        let beside = if against { line(to, from) } else { line(from, to) };
        let mut map = straight();
        map.lanes.push(lane("beside", beside, None));
        scene("street", vec![bystander(), car("drifts", 0.0, 0.0, 0.0, 8.0)], map)
    };
    for smoothing in Smoothing::ALL {
        let controller =
            smoothing.behind("goes", Controller::Fair(Box::new(Goes(Vec2::new(8.0, 1.0))))).unwrap();
        let aside = |scenario: &Scenario| {
            let states = future(scenario, &run(&controller, scenario), "drifts");
            states.iter().map(|s| s.y).fold(f64::NEG_INFINITY, f64::max)
        };
        let (held, free) = (aside(&two_ways(true)), aside(&two_ways(false)));
        assert!(held < 2.0, "{held}");
        assert!(free > 2.5, "{free}");
    }
}

#[test]
fn nothing_depends_on_batches_or_threads() {
    let scenarios = mini();
    let controller = behind(Smoothing::Full, "constant-velocity");
    let alone: Vec<Rollout> = scenarios.iter().map(|s| run(&controller, s)).collect();
    let together = |scenarios: &[Scenario]| -> Vec<Rollout> {
        let av = |scenario: &Scenario| scenario.deviation.as_ref().unwrap().track.clone();
        let batch = scenarios.iter().map(|scenario| request(scenario, av(scenario), 0)).collect();
        roll_out(batch, &controller, &Settings::default()).into_iter().map(Result::unwrap).collect()
    };
    assert!(together(&scenarios) == alone);
    let halves = std::thread::scope(|scope| {
        let (first, second) = scenarios.split_at(5);
        let handle = scope.spawn(|| together(second));
        let mut all = together(first);
        all.extend(handle.join().unwrap());
        all
    });
    assert!(halves == alone);
}

#[test]
fn ids_say_which_stage_is_behind() {
    let ids = ["stop".to_owned(), "stop+qp".to_owned(), "constant-velocity+qp-alone".to_owned()];
    let all = PlannedSimulator::by_ids(&ids).unwrap();
    assert_eq!(all.iter().map(|s| s.id.clone()).collect::<Vec<_>>(), ids);
    assert_ne!(all[0].card, all[1].card);
    assert_eq!(all[1].title, "Stop + qp");
    let asked = Adjustments { smoothing: Some(Smoothing::Full), ..Adjustments::default() };
    let names = ["log-replay".to_owned(), "stop".to_owned()];
    let all = PlannedSimulator::adjusted(&names, &asked).unwrap();
    assert_eq!(all.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["log-replay", "stop+qp"]);
    let refused = |id: &str| PlannedSimulator::by_ids(&[id.to_owned()]).err().unwrap();
    for id in ["log-replay+qp", "qp-regression+qp"] {
        assert!(matches!(refused(id), EvaluationError::Model(ModelError::TakesNoStage { .. })));
    }
    assert!(matches!(refused("stop+pq"), EvaluationError::UnknownSimulator { .. }));
    // A simulator that contains the stage does not get another one.
    let names = ["qp-regression".to_owned(), "regression".to_owned()];
    let all = PlannedSimulator::adjusted(&names, &asked).unwrap();
    assert_eq!(all.iter().map(|s| s.id.as_str()).collect::<Vec<_>>(), ["qp-regression", "regression+qp"]);
}

#[test]
fn weights_of_a_simulator_are_those_of_it_with_a_stage_too() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("some.safetensors");
    let weights = crate::model_weights::untrained("pufferdrive").unwrap();
    std::fs::write(&file, &weights.bytes).unwrap();
    let weights = vec![("pufferdrive".to_owned(), weights_file(&file).unwrap())];
    let asked = Adjustments { weights, ..Adjustments::default() };
    let all = PlannedSimulator::adjusted(&["pufferdrive+qp".to_owned()], &asked).unwrap();
    assert_eq!(all[0].weights.as_ref().map(|w| w.name.as_str()), Some("some.safetensors"));
}
