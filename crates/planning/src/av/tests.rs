use std::collections::BTreeSet;
use std::f64::consts::FRAC_PI_2;
use std::sync::{Arc, Mutex};

use reactsim_geometry::Vec2;
use reactsim_rollout::{
    Controller as TrafficController, Episode as PlannedEpisode, Memory, Oracle, PlanError, Request, Rollout,
    RolloutError, Settings, roll_out,
};
use reactsim_scene::{
    AgentKind, CURRENT, DT, FRAMES, FUTURE, Frame, HISTORY, LaneClass, LaneKind, LaneParts, Length,
    LightParts, LightState as SceneLight, LoggedAgent,
};

use super::*;
use crate::closed_loop::{Drive, EpisodeStart, Replay, Surroundings};
use crate::fixtures::scenes::{agent, beside, lane, parts, scenario, straight_track, track};
use crate::from_scene::rollout_objects;
use crate::planner::{Light, LightState, PlannerInput};
use crate::tracking::Controller;

/// Traffic that replays its log.
struct LogReplay;

impl Oracle for LogReplay {
    fn begin(&self, scenario: &Scenario) -> Memory {
        Memory::new(scenario.log_future.tracks.clone())
    }

    fn plan(&self, batch: &mut [PlannedEpisode<'_>]) -> Result<(), PlanError> {
        for episode in batch {
            let step = episode.seen.step();
            let log = episode.memory.get::<Vec<Vec<Frame>>>().unwrap();
            for (agent, track) in log.iter().enumerate() {
                for k in 0..episode.plan.steps() {
                    episode.plan.set(agent, k, track[step + k]);
                }
            }
        }
        Ok(())
    }
}

fn every(steps: usize) -> Replan {
    Replan::every(steps).unwrap()
}

fn run(scenario: &Scenario, av: PlannerAv) -> Result<Rollout, RolloutError> {
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: 0 };
    let traffic = TrafficController::Oracle(Box::new(LogReplay));
    roll_out(vec![request], &traffic, &Settings::default()).remove(0)
}

fn planned(scenario: &Scenario, planner: PlannerChoice, steps: usize) -> PlannerAv {
    PlannerAv::new(scenario, planner, Controller::LqrBicycle, every(steps)).unwrap()
}

/// Returns the states of the AV from the current frame on.
fn driven(scenario: &Scenario, planner: PlannerChoice, steps: usize) -> Vec<AgentState> {
    let rollout = run(scenario, planned(scenario, planner, steps)).unwrap();
    rollout.tracks[AV][CURRENT..].iter().map(|frame| frame.unwrap()).collect()
}

fn car(id: &str, track: Vec<Frame>) -> LoggedAgent {
    agent(id, AgentKind::Vehicle, track)
}

/// A road along the x axis of one lane, then a connector, then one lane.
fn straight_road() -> Vec<LaneParts> {
    vec![
        lane("in", &[(-100.0, 0.0), (40.0, 0.0)], &["through"]),
        LaneParts { kind: LaneKind::Connector, ..lane("through", &[(40.0, 0.0), (60.0, 0.0)], &["out"]) },
        lane("out", &[(60.0, 0.0), (400.0, 0.0)], &[]),
    ]
}

/// Radius of the bend, metres.
const RADIUS: f64 = 40.0;
/// Arc length at which the bend begins, metres.
const BEND: f64 = 20.0;

/// Returns the point and the heading of a road with a right-angled bend to the left.
fn bent(s: f64) -> (Vec2, f64) {
    let angle = ((s - BEND) / RADIUS).clamp(0.0, FRAC_PI_2);
    let beyond = (s - BEND - RADIUS * FRAC_PI_2).max(0.0);
    let arc = Vec2::new(RADIUS * angle.sin(), RADIUS * (1.0 - angle.cos()));
    (Vec2::new(s.min(BEND) + arc.x, arc.y + beyond), angle)
}

/// A scenario in a bend, with the AV behind a car that drives at 3 m/s.
fn behind_a_slow_car() -> Scenario {
    let points = |from: i32, to: i32| -> Vec<(f64, f64)> {
        (from..=to).map(|s| bent(f64::from(2 * s)).0).map(|p| (p.x, p.y)).collect()
    };
    let road = vec![
        lane("in", &points(-40, 10), &["bend"]),
        lane("bend", &points(10, 41), &["out"]),
        lane("out", &points(41, 160), &[]),
    ];
    let leader = track(3.0, |way| bent(way + 30.0));
    scenario(vec![car("av", track(8.0, bent)), car("leader", leader)], road)
}

#[test]
fn planners_drive_along_a_free_road() {
    let free = scenario(vec![car("av", straight_track(0.0, 0.3, 8.0))], straight_road());
    for planner in PlannerChoice::ALL {
        for steps in [1, 5] {
            let states = driven(&free, planner, steps);
            let last = states.last().unwrap();
            assert!((60.0..84.0).contains(&last.x), "{planner:?}, {steps}: {last:?}");
            assert!(last.y.abs() < 0.2 && last.heading.abs() < 0.05, "{planner:?}, {steps}: {last:?}");
            assert!(states.windows(2).all(|pair| (pair[1].x - pair[0].x) < 1.1), "{planner:?}, {steps}");
        }
        // Plans are kept in between.
        assert_ne!(driven(&free, planner, 1), driven(&free, planner, 5));
    }
}

#[test]
fn a_lane_beside_that_is_cut_elsewhere_changes_nothing() {
    let road = |cut: bool, linked: bool| {
        let mut lanes = vec![
            lane("a1", &[(-100.0, 0.0), (30.0, 0.0)], &["a2"]),
            lane("a2", &[(30.0, 0.0), (400.0, 0.0)], &[]),
        ];
        if cut {
            lanes.push(lane("b1", &[(-100.0, 3.5), (30.0, 3.5)], &["b2"]));
            lanes.push(lane("b2", &[(30.0, 3.5), (400.0, 3.5)], &[]));
        } else {
            lanes.push(lane("b1", &[(-100.0, 3.5), (400.0, 3.5)], &[]));
        }
        if linked {
            lanes[0].left.push(beside("b1"));
            lanes[1].left.push(beside(if cut { "b2" } else { "b1" }));
        }
        scenario(vec![car("av", straight_track(0.0, 0.0, 10.0))], lanes)
    };
    for planner in PlannerChoice::ALL {
        let whole = driven(&road(false, true), planner, 1);
        assert!(whole[80].x > 75.0, "{planner:?}: {:?}", whole[80]);
        assert_eq!(whole, driven(&road(true, true), planner, 1), "{planner:?}");
        assert_eq!(whole, driven(&road(false, false), planner, 1), "{planner:?}");
    }
}

#[test]
fn planners_follow_a_slow_car_through_a_bend() {
    let scenario = behind_a_slow_car();
    for planner in PlannerChoice::ALL {
        for steps in [1, 5] {
            let rollout = run(&scenario, planned(&scenario, planner, steps)).unwrap();
            let [av, leader] = rollout.tracks.as_slice() else { panic!("two agents are expected") };
            let mut nearest = f64::INFINITY;
            for (av, leader) in av.iter().zip(leader).skip(CURRENT) {
                let footprint = |frame: &Frame, i: usize| frame.unwrap().footprint(&scenario.start.agents[i]);
                nearest = nearest.min(footprint(av, 0).separation(&footprint(leader, 1)));
            }
            assert!((0.5..15.0).contains(&nearest), "{planner:?}, {steps}: {nearest}");
            let last = av[FRAMES - 1].unwrap();
            assert!(
                last.heading > 0.2 && (1.5..4.5).contains(&last.speed()),
                "{planner:?}, {steps}: {last:?}"
            );
        }
    }
}

/// A scenario with a car on the road, a pedestrian and a cone next to it, a light that turns green, and bike
/// lanes, which planning maps leave out.
fn junction() -> Scenario {
    let bike =
        |id: &str, y: f64| LaneParts { class: LaneClass::Bike, ..lane(id, &[(-100.0, y), (40.0, y)], &[]) };
    let mut road = vec![bike("bike 1", 3.0)];
    road.extend(straight_road());
    road.push(bike("bike 2", -3.0));
    let agents = vec![
        car("av", straight_track(0.0, 0.0, 8.0)),
        car("leader", straight_track(25.0, 0.2, 6.0)),
        agent("walker", AgentKind::Pedestrian, track(1.0, |way| (Vec2::new(50.0, way - 12.0), FRAC_PI_2))),
        agent("cone", AgentKind::Other, straight_track(30.0, 4.0, 0.0)),
    ];
    let states = |frame: usize| match frame {
        0..40 => SceneLight::Stop,
        _ => SceneLight::ArrowGo,
    };
    let light = |id: &str, states: &dyn Fn(usize) -> SceneLight| LightParts {
        lane: id.into(),
        stop_point: Vec2::new(40.0, 0.0),
        states: (0..FRAMES).map(|frame| Some(states(frame))).collect(),
    };
    let mut parts = parts(agents, road);
    parts.lights = vec![light("bike 1", &|_| SceneLight::Stop), light("through", &states)];
    Scenario::assemble(parts).unwrap()
}

/// Drives the junction in the closed loop of this crate, without any part of a policy.
fn closed_loop(scenario: &Scenario, planner: PlannerChoice, controller: Controller, steps: usize) -> Drive {
    let map = planning_map(scenario).unwrap();
    let shape = EgoShape::from_box(4.8, 2.0);
    let through = map.find_lane("through").unwrap();
    let log: Vec<Vec<Frame>> = (0..scenario.start.agents.len()).map(|i| scenario.logged(i)).collect();
    let objects = rollout_objects(scenario, &log, &mut BTreeSet::new());
    let surroundings: Vec<Surroundings> = (CURRENT..FRAMES)
        .zip(objects)
        .map(|(frame, objects)| {
            let state = if frame < 40 { LightState::Red } else { LightState::Green };
            Surroundings { objects, lights: vec![Light { lane: through, state }] }
        })
        .collect();
    let ego = EgoState { vx: 8.0, ..EgoState::standing(Vec2::new(-shape.rear_axle_to_center, 0.0), 0.0) };
    let start = EpisodeStart {
        history: vec![Sample { ego, objects: surroundings[0].objects.clone() }],
        lights: surroundings[0].lights.clone(),
    };
    let route = Route::new(&map, ["roadblock of in", "roadblock of through", "roadblock of out"]).unwrap();
    let episode = Episode {
        map: &map,
        route: &route,
        shape: &shape,
        controller,
        steps: FUTURE,
        replan_interval: steps,
    };
    episode.run(start, planner.new_planner().as_mut(), &mut Replay::new(surroundings)).unwrap()
}

#[test]
fn rollouts_with_recorded_traffic_equal_the_closed_loop() {
    let scenario = junction();
    let cases = [
        (PlannerChoice::PdmClosed, Controller::LqrBicycle),
        (PlannerChoice::Idm, Controller::LqrBicycle),
        (PlannerChoice::Idm, Controller::PerfectTracking),
    ];
    for (planner, controller) in cases {
        for steps in [1, 5] {
            let av = PlannerAv::new(&scenario, planner, controller, every(steps)).unwrap();
            let shape = *av.shape();
            let rollout = run(&scenario, av).unwrap();
            let drive = closed_loop(&scenario, planner, controller, steps);
            assert_eq!(drive.samples.len(), FUTURE + 1);
            for (k, sample) in drive.samples.iter().enumerate() {
                let (center, state) = (sample.ego.center(&shape), rollout.tracks[AV][CURRENT + k].unwrap());
                assert_eq!(center, state.position(), "{planner:?} {controller:?} {k}");
                assert_eq!(sample.ego.heading, state.heading, "{planner:?} {controller:?} {k}");
            }
            let end = rollout.tracks[AV][FRAMES - 1].unwrap();
            assert!(20.0 < end.x && end.x < 70.0, "{planner:?} {controller:?}: {end:?}");
        }
    }
}

#[test]
fn red_lights_are_observed() {
    let mut green = junction();
    green.start.light_history[1].fill(Some(SceneLight::Go));
    green.log_future.lights[1].fill(Some(SceneLight::Go));
    for planner in PlannerChoice::ALL {
        let (red, free) = (driven(&junction(), planner, 1), driven(&green, planner, 1));
        assert!(red[30].x + 2.4 < 40.0, "{planner:?}: {:?}", red[30]);
        assert!(red[80].x < free[80].x, "{planner:?}");
    }
}

#[test]
fn the_logged_future_decides_about_the_route_only() {
    let scenario = junction();
    let route = |scenario: &Scenario| planned(scenario, PlannerChoice::Idm, 1).route().clone();
    // The logged AV stops, and moves sideways within its lane.
    let mut other = scenario.clone();
    for (k, frame) in other.log_future.tracks[AV].iter_mut().enumerate() {
        let state = frame.as_mut().unwrap();
        (state.x, state.y, state.vx) = (0.2, 0.01 * k as f64, 0.0);
    }
    assert_eq!(route(&other), route(&scenario));
    // Without any future of the AV; the traffic is the same.
    let mut without = scenario.clone();
    without.log_future.tracks[AV].fill(None);
    assert_eq!(route(&without), route(&scenario));
    for planner in PlannerChoice::ALL {
        let states = driven(&scenario, planner, 1);
        assert_eq!(driven(&other, planner, 1), states, "{planner:?}");
        assert_eq!(driven(&without, planner, 1), states, "{planner:?}");
    }
}

#[test]
fn policies_do_not_depend_on_later_frames() {
    let scenario = junction();
    let mut later = scenario.clone();
    let from = 30;
    for track in &mut later.log_future.tracks[1..] {
        for state in track[from..].iter_mut().flatten() {
            state.x -= 7.0;
        }
    }
    later.log_future.lights[1][from..].fill(Some(SceneLight::Stop));
    for planner in PlannerChoice::ALL {
        let (first, second) = (driven(&scenario, planner, 1), driven(&later, planner, 1));
        // The state of a step is planned from what is observed at the step before.
        assert_eq!(first[..=from + 1], second[..=from + 1], "{planner:?}");
        assert_ne!(first, second, "{planner:?}");
    }
}

/// A planner that keeps its inputs, and drives straight on.
struct Recorder {
    inputs: Arc<Mutex<Vec<Vec<Sample>>>>,
    change: fn(usize, &mut EgoState),
}

impl Planner for Recorder {
    fn plan(&mut self, input: &PlannerInput<'_>) -> Result<Trajectory, PlanningError> {
        let samples = input.history.past().iter().chain([input.history.present()]).cloned().collect();
        self.inputs.lock().unwrap().push(samples);
        let ego = *input.ego();
        let state = |step: usize| {
            let elapsed = crate::STEP * step as f64;
            let mut state = EgoState { time: ego.time + elapsed, x: ego.x + ego.vx * elapsed, ..ego };
            (self.change)(step, &mut state);
            state
        };
        Ok(Trajectory::new((0..=20).map(state).collect(), &ego)?)
    }
}

fn recorder(
    scenario: &Scenario,
    change: fn(usize, &mut EgoState),
    controller: Controller,
) -> (PlannerAv, Arc<Mutex<Vec<Vec<Sample>>>>) {
    let inputs = Arc::default();
    let shared = Arc::clone(&inputs);
    let new = move |_| Box::new(Recorder { inputs: Arc::clone(&shared), change }) as Box<dyn Planner>;
    (PlannerAv::with_planner(scenario, new, controller, every(1)).unwrap(), inputs)
}

#[test]
fn planners_observe_the_last_two_seconds() {
    let mut scenario = junction();
    // An agent that appears with unknown velocity: 0, then the backward difference.
    scenario.start.history[2][..5].fill(None);
    let state = scenario.start.history[2][5].as_mut().unwrap();
    (state.vx, state.vy) = (f64::NAN, f64::NAN);
    let state = scenario.start.history[2][6].as_mut().unwrap();
    (state.vx, state.vy) = (f64::NAN, f64::NAN);
    let (av, inputs) = recorder(&scenario, |_, _| (), Controller::LqrBicycle);
    run(&scenario, av).unwrap();
    let inputs = inputs.lock().unwrap();
    assert_eq!(inputs.len(), FUTURE);
    let lengths: Vec<usize> = inputs.iter().map(Vec::len).collect();
    assert_eq!((lengths[0], lengths[9], lengths[10], lengths[79]), (HISTORY, 20, 21, 21));
    let times: Vec<f64> = inputs[79].iter().map(|sample| sample.ego.time).collect();
    assert!((times[20] - 7.9).abs() < 1e-9 && (times[0] - 5.9).abs() < 1e-9);
    let first = &inputs[0];
    assert!((first[0].ego.time + 1.0).abs() < 1e-12 && first[10].ego.time == 0.0);
    let walker = |frame: usize| first[frame].objects.iter().find(|o| &*o.id == "walker");
    assert!(walker(4).is_none());
    assert_eq!(walker(5).unwrap().velocity, Vec2::zeros());
    assert!((walker(6).unwrap().velocity - Vec2::new(0.0, 1.0)).norm() < 1e-9);
    assert!(first.iter().all(|sample| sample.objects.iter().any(|o| &*o.id == "obstacle:0")));
}

#[test]
fn faulty_plans_are_errors() {
    let scenario = junction();
    let error = |change, controller| {
        let (av, _) = recorder(&scenario, change, controller);
        match run(&scenario, av).unwrap_err() {
            RolloutError::Av { source, .. } => source,
            other => panic!("{other}"),
        }
    };
    let nan = error(
        |step, state| {
            if step == 3 {
                state.y = f64::NAN
            }
        },
        Controller::LqrBicycle,
    );
    let expected = "the planner does not drive the AV to step 1: \
                    planned states are not a trajectory: state 3 of the trajectory is not finite";
    assert!(nan.0.starts_with(expected), "{nan}");
    let teleport = error(|step, state| state.x += 60.0 * step as f64, Controller::LqrBicycle);
    assert!(teleport.to_string().contains("speeds must be below 50"), "{teleport}");
    let short = error(|step, state| state.time = 1e-3 * step as f64, Controller::LqrBicycle);
    assert!(short.0.starts_with("the planner does not drive the AV to step 1: "), "{short}");
    let far = error(|_, state| state.y += 9.5, Controller::PerfectTracking);
    assert!(far.0.contains("between steps 0 and 1"), "{far}");
}

#[test]
fn scenarios_without_a_route_are_refused_by_name() {
    let bare = scenario(vec![car("av", straight_track(0.0, 0.0, 8.0))], Vec::new());
    let new = |scenario: &Scenario, planner, controller| {
        PlannerAv::new(scenario, planner, controller, every(1)).unwrap_err().to_string()
    };
    assert_eq!(
        new(&bare, PlannerChoice::Idm, Controller::LqrBicycle),
        "scenario `made`: the map has no lanes for motor vehicles, so there is no route for a planner; choose \
         an AV that needs no lanes, such as `constant-velocity`"
    );
    assert_eq!(
        new(&junction(), PlannerChoice::PdmClosed, Controller::PerfectTracking),
        "planner `pdm-closed` returns poses without velocities, which perfect tracking cannot follow; choose \
         the LQR tracker with the bicycle"
    );
}

#[test]
fn ids_of_planners_are_unique() {
    for planner in PlannerChoice::ALL {
        assert_eq!(PlannerChoice::from_id(planner.id()), Some(planner));
    }
    assert_eq!(PlannerChoice::from_id("PDM-Closed"), None);
}

#[test]
fn the_velocity_is_that_of_the_centre() {
    let turning = EgoState { vx: 5.0, yaw_rate: 0.5, ..EgoState::standing(Vec2::zeros(), FRAC_PI_2) };
    let state = state_of_box(&turning, &EgoShape::PACIFICA);
    assert!((state.position() - Vec2::new(0.0, 1.461)).norm() < 1e-12);
    assert!((state.vx + 0.5 * 1.461).abs() < 1e-12 && (state.vy - 5.0).abs() < 1e-12);
}

#[test]
fn planners_drive_scenarios_of_any_length() {
    for (history, future) in [(2, 60), (11, 150), (21, 300)] {
        let length = Length { history, future };
        let state = |frame: usize| {
            let x = 8.0 * DT * (frame as f64 - length.current() as f64);
            Some(AgentState { x, y: 0.3, heading: 0.0, vx: 8.0, vy: 0.0 })
        };
        let mut parts = parts(vec![car("av", (0..length.frames()).map(state).collect())], straight_road());
        parts.length = length;
        let scenario = Scenario::assemble(parts).unwrap();
        for planner in PlannerChoice::ALL {
            let rollout = run(&scenario, planned(&scenario, planner, 5)).unwrap();
            let track = &rollout.tracks[AV];
            assert_eq!(track.len(), length.frames());
            let (now, last) = (track[length.current()].unwrap(), track[length.frames() - 1].unwrap());
            let driven = last.x - now.x;
            let log = 8.0 * DT * future as f64;
            assert!((0.7 * log..1.3 * log).contains(&driven), "{planner:?}, {length}: {driven}");
        }
    }
}
