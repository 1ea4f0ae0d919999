//! Parts of hand-built scenes, and values computed from their rollouts.

use std::sync::Arc;

use reactsim::formats;
use reactsim::geometry::{Vec2, direction, rounded_distance};
use reactsim::metrics::{self, Case, Options, Scores};
use reactsim::models;
use reactsim::rollout::{Controller, DeviatedAv, Request, Rollout, Settings, roll_out};
use reactsim::scene::{
    Agent, AgentKind, AgentState, CURRENT, DT, FRAMES, FUTURE, Frame, LaneKind, LaneParts, LightParts,
    LightState, LoggedAgent, MapParts, Scenario, ScenarioParts,
};

use crate::program::MINI;

/// Returns a state that moves along its heading.
pub(crate) fn state(x: f64, y: f64, heading: f64, speed: f64) -> AgentState {
    let v = direction(heading) * speed;
    AgentState { x, y, heading, vx: v.x, vy: v.y }
}

/// Returns the state `seconds` later at constant velocity.
pub(crate) fn later(now: &AgentState, seconds: f64) -> AgentState {
    AgentState { x: now.x + now.vx * seconds, y: now.y + now.vy * seconds, ..*now }
}

/// Returns an agent of the usual size of its kind that is at `now` at the current frame and keeps its
/// velocity throughout.
pub(crate) fn agent(id: &str, kind: AgentKind, now: AgentState) -> LoggedAgent {
    let (length, width) = match kind {
        AgentKind::Vehicle => (4.6, 1.9),
        AgentKind::Pedestrian => (0.8, 0.8),
        AgentKind::Cyclist => (1.8, 0.7),
        AgentKind::Other => (0.6, 0.6),
    };
    let track = (0..FRAMES).map(|f| Some(later(&now, (f as f64 - CURRENT as f64) * DT)));
    LoggedAgent {
        agent: Agent { id: id.to_owned(), kind, length, width },
        track: track.collect(),
        heights: Vec::new(),
    }
}

pub(crate) fn car(id: &str, x: f64, y: f64, heading: f64, speed: f64) -> LoggedAgent {
    agent(id, AgentKind::Vehicle, state(x, y, heading, speed))
}

/// Returns an AV that stands far from the other agents.
pub(crate) fn bystander() -> LoggedAgent {
    car("av", 0.0, 400.0, 0.0, 0.0)
}

/// Returns a lane of 3.5 m along points.
pub(crate) fn lane(id: &str, points: Vec<Vec2>, speed_limit: Option<f64>) -> LaneParts {
    LaneParts { id: id.to_owned(), kind: LaneKind::Connector, speed_limit, points, ..LaneParts::default() }
}

/// Returns points every 2 m from one position to another.
pub(crate) fn line(from: (f64, f64), to: (f64, f64)) -> Vec<Vec2> {
    let (a, b) = (Vec2::new(from.0, from.1), Vec2::new(to.0, to.1));
    let n = ((b - a).norm() / 2.0).ceil().max(1.0) as usize;
    (0..=n).map(|i| a + (b - a) * (i as f64 / n as f64)).collect()
}

/// Returns points every metre of an arc that begins at `from` with a heading and turns by `angle`, left
/// positive.
pub(crate) fn arc(from: (f64, f64), heading: f64, radius: f64, angle: f64) -> Vec<Vec2> {
    let side = radius.copysign(angle);
    let center = Vec2::new(from.0, from.1) + Vec2::new(-heading.sin(), heading.cos()) * side;
    let n = (radius * angle.abs()).ceil() as usize;
    let at = |i: usize| {
        let h = heading + angle * i as f64 / n as f64;
        center + Vec2::new(h.sin(), -h.cos()) * side
    };
    (0..=n).map(at).collect()
}

/// Lets one lane follow another.
pub(crate) fn join(lanes: &mut [LaneParts], from: &str, to: &str) {
    for lane in lanes {
        if lane.id == from {
            lane.successors.push(to.to_owned());
        }
        if lane.id == to {
            lane.predecessors.push(from.to_owned());
        }
    }
}

/// Returns a long straight lane along the x axis.
pub(crate) fn straight() -> MapParts {
    MapParts {
        lanes: vec![lane("main", line((-150.0, 0.0), (350.0, 0.0)), Some(15.0))],
        ..MapParts::default()
    }
}

/// Returns a light on a lane, with its state at each frame.
pub(crate) fn light(lane: &str, at: (f64, f64), shows: impl Fn(usize) -> LightState) -> LightParts {
    LightParts {
        lane: lane.to_owned(),
        stop_point: Vec2::new(at.0, at.1),
        states: (0..FRAMES).map(|f| Some(shows(f))).collect(),
    }
}

/// Returns the parts of a scene in world coordinates; the first agent is the AV.
pub(crate) fn parts(id: &str, agents: Vec<LoggedAgent>, map: MapParts) -> ScenarioParts {
    ScenarioParts {
        id: id.to_owned(),
        source: "hand-built".to_owned(),
        origin: Some(Vec2::zeros()),
        agents,
        map,
        ..ScenarioParts::default()
    }
}

/// Returns the scene of these agents, of which the first is the AV.
pub(crate) fn scene(id: &str, agents: Vec<LoggedAgent>, map: MapParts) -> Scenario {
    Scenario::assemble(parts(id, agents, map)).unwrap()
}

/// Returns the scenarios that ship with the program.
pub(crate) fn mini() -> Vec<Scenario> {
    formats::open(MINI.as_ref()).unwrap().map(Result::unwrap).collect()
}

/// Returns the first real logs of the training split whose AV is always present; none if the data are
/// missing.
pub(crate) fn real(count: usize) -> Vec<Scenario> {
    let Some(folder) = crate::shared("data/womd/train") else { return Vec::new() };
    let all = formats::open(&folder).unwrap().map(Result::unwrap);
    all.filter(|s| s.log_future.tracks[0].iter().all(Option::is_some)).take(count).collect()
}

/// Returns the AV as it is now, at constant velocity.
pub(crate) fn coasting(scenario: &Scenario) -> Vec<AgentState> {
    let now = scenario.start.now(0);
    (1..=FUTURE).map(|k| later(&now, k as f64 * DT)).collect()
}

/// Returns a request with a given AV.
pub(crate) fn request(scenario: &Scenario, av: Vec<AgentState>, rollout: u32) -> Request<'_> {
    let av = DeviatedAv::new(scenario, av).unwrap();
    Request { scenario, av: Some(Arc::new(av)), rollout }
}

/// Returns a rollout with a given AV.
pub(crate) fn roll(
    scenario: &Scenario,
    av: Vec<AgentState>,
    controller: &Controller,
    settings: &Settings,
) -> Rollout {
    roll_out(vec![request(scenario, av, 0)], controller, settings).remove(0).unwrap()
}

/// Returns a rollout of a baseline with a given AV.
pub(crate) fn roll_with(
    model: &str,
    scenario: &Scenario,
    av: Vec<AgentState>,
    settings: &Settings,
    rollout: u32,
) -> Rollout {
    let controller = models::find(model).unwrap().simulator().unwrap();
    roll_out(vec![request(scenario, av, rollout)], &controller, settings).remove(0).unwrap()
}

/// Returns a rollout of IDM; the AV keeps its velocity.
pub(crate) fn idm(scenario: &Scenario) -> Rollout {
    roll_with("idm", scenario, coasting(scenario), &Settings::default(), 0)
}

pub(crate) fn scores(scenario: &Scenario, rollout: &Rollout) -> Scores {
    metrics::score_case(&Case::of_rollout(scenario, &rollout.tracks, Options::default()))
}

/// Returns the states of an agent from the current frame on. It must be present throughout.
pub(crate) fn future(scenario: &Scenario, rollout: &Rollout, id: &str) -> Vec<AgentState> {
    let i = slot(scenario, id);
    let states = rollout.tracks[i][CURRENT..].iter().enumerate();
    states.map(|(k, s)| s.unwrap_or_else(|| panic!("{}: `{id}` vanishes at step {k}", scenario.id))).collect()
}

pub(crate) fn slot(scenario: &Scenario, id: &str) -> usize {
    scenario.start.agents.iter().position(|a| a.id == id).unwrap()
}

/// Returns the first step at which any two of the agents overlap, with their ids.
pub(crate) fn contact(scenario: &Scenario, rollout: &Rollout) -> Option<(usize, String, String)> {
    let agents = &scenario.start.agents;
    let boxes = |f: usize, i: usize| rollout.tracks[i][f].map(|s| s.footprint(&agents[i]));
    for f in CURRENT..FRAMES {
        for i in 0..agents.len() {
            for j in i + 1..agents.len() {
                if let (Some(a), Some(b)) = (boxes(f, i), boxes(f, j))
                    && rounded_distance(&a, &b, 0.7) < 0.0
                {
                    return Some((f - CURRENT, agents[i].id.clone(), agents[j].id.clone()));
                }
            }
        }
    }
    None
}

/// Returns the accelerations along a track, m/s².
pub(crate) fn accelerations(track: &[AgentState]) -> Vec<f64> {
    track.windows(2).map(|w| (w[1].speed() - w[0].speed()) / DT).collect()
}

/// Returns everything in a rollout as bits, so that unknown values compare too.
pub(crate) fn bits(tracks: &[Vec<Frame>]) -> Vec<Vec<Option<[u64; 5]>>> {
    let of = |s: &AgentState| [s.x, s.y, s.heading, s.vx, s.vy].map(f64::to_bits);
    tracks.iter().map(|t| t.iter().map(|s| s.as_ref().map(of)).collect()).collect()
}
