//! The simulator on small scenes: it moves vehicles as the agents themselves, which golden documents check.

use std::sync::Arc;

use reactsim_geometry::{Vec2, direction};
use reactsim_planning::from_scene::SceneRoads;
use reactsim_planning::idm_agents::{IdmAgents, SeenEgo, Step};
use reactsim_planning::{ObjectId, ObjectKind, TrackedObject};
use reactsim_rollout::{
    DeviatedAv, Protocol, Replan, Request, Rollout, Settings, SimulatedAv, Simulator, roll_out,
};
use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, FRAMES, FUTURE, Frame, HISTORY, LaneParts, LightParts,
    LightState, LoggedAgent, MapParts, Scenario, ScenarioParts,
};

use super::*;

/// Returns an agent that keeps its velocity along its heading, and is at `(x, y)` at the current frame.
fn agent(id: &str, kind: AgentKind, [x, y]: [f64; 2], heading: f64, speed: f64) -> LoggedAgent {
    let (length, width) = if kind == AgentKind::Vehicle { (4.6, 1.9) } else { (0.8, 0.8) };
    let v = direction(heading) * speed;
    let at = |frame: usize| {
        let p = Vec2::new(x, y) + v * ((frame as f64 - CURRENT as f64) * DT);
        Some(AgentState { x: p.x, y: p.y, heading, vx: v.x, vy: v.y })
    };
    let agent = Agent { id: id.to_owned(), kind, length, width };
    LoggedAgent { agent, track: (0..FRAMES).map(at).collect(), heights: Vec::new() }
}

fn car(id: &str, at: [f64; 2], heading: f64, speed: f64) -> LoggedAgent {
    agent(id, AgentKind::Vehicle, at, heading, speed)
}

/// Returns a scenario on a road along the x axis: a lane up to 350 m with the limit 15 m/s, and a lane behind
/// it with these lights.
fn scene(agents: Vec<LoggedAgent>, lights: Vec<LightParts>) -> Scenario {
    let lane = |id: &str, x: [f64; 2], before: &[&str], after: &[&str]| LaneParts {
        id: id.into(),
        speed_limit: Some(15.0),
        points: (0..=50).map(|i| Vec2::new(x[0] + (x[1] - x[0]) * f64::from(i) / 50.0, 0.0)).collect(),
        predecessors: before.iter().map(|&id| id.into()).collect(),
        successors: after.iter().map(|&id| id.into()).collect(),
        ..LaneParts::default()
    };
    let lanes = vec![lane("main", [-150.0, 40.0], &[], &["on"]), lane("on", [40.0, 350.0], &["main"], &[])];
    let stop_lines = lights.iter().map(LightParts::stop_line).collect();
    let map = MapParts { lanes, stop_lines, ..MapParts::default() };
    let origin = Some(Vec2::zeros());
    Scenario::assemble(ScenarioParts {
        id: "made".into(),
        origin,
        agents,
        map,
        lights,
        ..ScenarioParts::default()
    })
    .unwrap()
}

/// A slow AV on the road, vehicles before and behind it, and these agents.
fn on_the_road(mut others: Vec<LoggedAgent>) -> Scenario {
    let mut agents = vec![
        car("av", [0.0, 0.0], 0.0, 6.0),
        car("behind", [-25.0, 0.6], 0.0, 10.0),
        car("ahead", [30.0, -0.4], 0.1, 4.0),
    ];
    agents.append(&mut others);
    scene(agents, Vec::new())
}

fn simulator() -> Controller {
    ENTRY.simulator().unwrap()
}

fn every(steps: usize) -> Settings {
    Settings { replan: Replan::every(steps).unwrap(), ..Settings::default() }
}

/// Rolls out with an AV that keeps its velocity.
fn rolled(scenario: &Scenario, settings: &Settings) -> Rollout {
    let av = DeviatedAv::new(scenario, av_states(scenario)[1..].to_vec()).unwrap();
    let request = Request { scenario, av: Some(Arc::new(av)), rollout: 0 };
    roll_out(vec![request], &simulator(), settings).remove(0).unwrap()
}

/// Returns the states of the AV that keeps its velocity, from the current frame on.
fn av_states(scenario: &Scenario) -> Vec<AgentState> {
    let now = scenario.start.now(0);
    let at = |k: usize| {
        let p = now.position() + now.velocity().unwrap() * (DT * k as f64);
        AgentState { x: p.x, y: p.y, ..now }
    };
    (0..=FUTURE).map(at).collect()
}

/// Returns the states of an agent from the current frame on.
fn future(scenario: &Scenario, rollout: &Rollout, id: &str) -> Vec<AgentState> {
    let slot = scenario.start.agents.iter().position(|agent| agent.id == id).unwrap();
    rollout.tracks[slot][CURRENT..].iter().map(|state: &Frame| state.unwrap()).collect()
}

#[test]
fn planned_at_every_step_vehicles_are_the_agents_of_nuplan() {
    let scenario = on_the_road(Vec::new());
    let start = &scenario.start;
    let object = |slot: usize| {
        let (agent, now) = (&start.agents[slot], start.now(slot));
        TrackedObject {
            id: ObjectId::from(agent.id.as_str()),
            kind: ObjectKind::Vehicle,
            center: now.position(),
            heading: now.heading,
            length: agent.length,
            width: agent.width,
            velocity: now.velocity().unwrap(),
        }
    };
    let vehicles: Vec<TrackedObject> = (1..start.agents.len()).map(object).collect();
    let av = av_states(&scenario);
    let ego = |k: usize| {
        let footprint = av[k].footprint(&start.agents[0]);
        SeenEgo { footprint, heading: av[k].heading, speed: av[k].speed() }
    };
    let roads = SceneRoads::new(start).unwrap().roads;
    let parameters: Parameters = ENTRY.setup().unwrap().parameters().unwrap();
    // Those of the devkit.
    let Parameters { target_speed, min_gap, headway, acceleration, deceleration, min_path, radius } =
        parameters;
    let motion = [target_speed, min_gap, headway, acceleration, deceleration];
    assert_eq!((motion, min_path, radius), ([10.0, 1.0, 1.5, 1.0, 2.0], 20.0, 100.0));
    let mut agents = IdmAgents::new(roads, parameters, &vehicles, Some(&ego(0)));
    let done = rolled(&scenario, &every(1));
    for step in 0..FUTURE {
        let ego = ego(step);
        agents.step(&Step { center: ego.footprint.center, ego: Some(ego), objects: &[], lights: &[] });
        assert_eq!(agents.agents().len(), 2);
        for agent in agents.agents() {
            let (found, expected) = (future(&scenario, &done, agent.id())[step + 1], agent.pose());
            let off = (found.position() - expected.position).norm();
            assert!(off < 1e-9, "{} after step {step}: {off} m", agent.id());
        }
    }
}

#[test]
fn vehicles_wait_behind_an_av_that_stands() {
    let agents = vec![car("av", [0.0, 0.0], 0.0, 0.0), car("behind", [-60.0, 0.0], 0.0, 8.0)];
    let scenario = scene(agents, Vec::new());
    for steps in [1, 5, 80] {
        let last = future(&scenario, &rolled(&scenario, &every(steps)), "behind")[80];
        assert!(-30.0 < last.x && last.x < -4.6 && last.speed() < 4.0, "{last:?}");
    }
}

#[test]
fn what_the_devkit_removes_keeps_its_velocity_unseen() {
    let others = vec![
        agent("rider", AgentKind::Cyclist, [-40.0, 0.0], 0.0, 3.0),
        agent("walker", AgentKind::Pedestrian, [60.0, 30.0], 1.5, 1.2),
        car("off", [10.0, 9.0], 0.3, 5.0),
        car("far", [150.0, 0.0], 0.0, 9.0),
    ];
    let (scenario, without) = (on_the_road(others), on_the_road(Vec::new()));
    let [done, alone] = [&scenario, &without].map(|scenario| rolled(scenario, &Settings::default()));
    for id in ["rider", "walker", "off", "far"] {
        let track = future(&scenario, &done, id);
        let expected = track[0].position() + track[0].velocity().unwrap() * 8.0;
        assert!((track[80].position() - expected).norm() < 1e-6, "{id}: {:?}", track[80]);
    }
    for id in ["behind", "ahead"] {
        assert_eq!(future(&scenario, &done, id)[80], future(&without, &alone, id)[80], "{id}");
    }
}

#[test]
fn walkers_and_obstacles_stop_vehicles() {
    for kind in [AgentKind::Pedestrian, AgentKind::Other] {
        let agents = vec![
            car("av", [0.0, 60.0], 0.0, 0.0),
            car("comes", [-50.0, 0.0], 0.0, 8.0),
            agent("in the way", kind, [0.0, 0.0], 0.0, 0.0),
        ];
        let scenario = scene(agents, Vec::new());
        let last = future(&scenario, &rolled(&scenario, &Settings::default()), "comes")[80];
        assert!(last.x < -2.7 && last.speed() < 3.0, "{kind}: {last:?}");
    }
}

#[test]
fn lights_that_are_not_green_end_the_path() {
    let passes = |state: LightState| {
        let light = LightParts {
            lane: "on".into(),
            stop_point: Vec2::new(40.0, 0.0),
            states: vec![Some(state); FRAMES],
        };
        let agents = vec![car("av", [0.0, 60.0], 0.0, 0.0), car("comes", [0.0, 0.0], 0.0, 9.0)];
        let scenario = scene(agents, vec![light]);
        let last = future(&scenario, &rolled(&scenario, &Settings::default()), "comes")[80];
        last.x > 40.0
    };
    assert!(passes(LightState::Go) && passes(LightState::ArrowGo) && passes(LightState::FlashingStop));
    assert!(!passes(LightState::Stop) && !passes(LightState::Caution) && !passes(LightState::Unknown));
}

#[test]
fn the_av_may_be_one_of_the_vehicles() {
    let scenario = on_the_road(Vec::new());
    let settings = Settings { protocol: Protocol::Realism, ..Settings::default() };
    let request = Request { scenario: &scenario, av: None, rollout: 0 };
    let done = roll_out(vec![request], &simulator(), &settings).remove(0).unwrap();
    let av = future(&scenario, &done, "av");
    assert!(av[80].x > 20.0 && av.iter().all(|state| state.y.abs() < 1e-9));
    assert_eq!(done.tracks[0].len(), HISTORY + FUTURE);
}

#[test]
fn a_planner_starts_from_what_others_did() {
    // The vehicle ahead stops in the log, and is followed where it is.
    let mut agents = vec![car("av", [0.0, 0.0], 0.0, 10.0), car("ahead", [37.0, 0.0], 0.0, 10.0)];
    for state in agents[1].track[HISTORY..].iter_mut().flatten() {
        *state = AgentState { x: 45.0, vx: 0.0, ..*state };
    }
    let scenario = scene(agents, Vec::new());
    for steps in [1, 5] {
        let Controller::Fair(inner) = simulator() else { unreachable!() };
        let inner: Arc<dyn Simulator> = Arc::from(inner);
        let av = SimulatedAv::new(&scenario, inner, Replan::every(steps).unwrap(), 0);
        let replay = Controller::Fair(Box::new(Replayed(scenario.log_future.tracks.clone())));
        let request = Request { scenario: &scenario, av: Some(Arc::new(av)), rollout: 0 };
        let done = roll_out(vec![request], &replay, &Settings::default()).remove(0).unwrap();
        let last = future(&scenario, &done, "av")[80];
        assert!(15.0 < last.x && last.x < 42.0, "{last:?}");
    }
}

/// Moves all agents as these tracks do.
struct Replayed(Vec<Vec<Frame>>);

impl SingleEpisode for Replayed {
    type Memory = ();

    fn id(&self) -> &'static str {
        "replayed"
    }

    fn begin(&self, _start: &Start, _stream: &mut Stream) {}

    fn plan_one(&self, _memory: &mut (), episode: &mut Planning<'_, '_>) -> Result<(), PlanError> {
        for (slot, track) in self.0.iter().enumerate() {
            for step in 0..episode.plan.steps() {
                episode.plan.set(slot, step, track[episode.seen.step() + step]);
            }
        }
        Ok(())
    }
}
