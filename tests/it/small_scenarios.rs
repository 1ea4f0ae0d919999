//! Small synthetic scenarios, for tests that need many of them fast.

use std::borrow::Borrow;
use std::path::Path;

use reactsim::evaluation::{AvChoice, FileRecord, Plan, PlannedSimulator, RunParts, RunSpec, Source};
use reactsim::formats::{decoded, native::Writer};
use reactsim::geometry::Vec2;
use reactsim::scene::{
    Agent, AgentKind, AgentState, Certificate, Deviation, DeviationParts, Effort, FRAMES, FUTURE, Frame,
    HISTORY, LaneParts, LoggedAgent, MapParts, Response, RoadEdge, RoadEdgeKind, Scenario, ScenarioParts,
};

/// Returns a vehicle along the x axis: present in all frames, with this position and speed at the current
/// frame.
fn driver(id: &str, x: f64, y: f64, speed: f64) -> LoggedAgent {
    let state =
        |f: usize| AgentState { x: x + speed * 0.1 * (f as f64 - 10.0), y, heading: 0.0, vx: speed, vy: 0.0 };
    LoggedAgent {
        agent: Agent { id: id.to_owned(), kind: AgentKind::Vehicle, length: 4.5, width: 2.0 },
        track: (0..FRAMES).map(|f| Some(state(f))).collect(),
        heights: Vec::new(),
    }
}

/// Returns scenario `i` of a family: a straight road, an AV with a follower, a leader and a neighbour; the
/// deviated AV brakes.
pub(crate) fn scenario(i: usize) -> Scenario {
    deviating(i, true)
}

/// Returns a file of deviations with the deviated AVs of these scenarios.
pub(crate) fn deviations(scenarios: &[usize]) -> serde_json::Value {
    let record = |i: &usize| {
        let deviation = scenario(*i).deviation.unwrap();
        let each = |of: fn(&AgentState) -> f64| deviation.track.iter().map(of).collect::<Vec<_>>();
        serde_json::json!({
            "scenario_id": format!("road-{i:03}"), "category": deviation.category.map(Deviation::name),
            "x": each(|s| s.x), "y": each(|s| s.y), "heading": each(|s| s.heading)
        })
    };
    let records: Vec<_> = scenarios.iter().map(record).collect();
    serde_json::json!({
        "format": "reactsim-deviations-v1", "frame": "scenario", "deviations": records
    })
}

/// As [`scenario`], with or without a deviated AV.
pub(crate) fn deviating(i: usize, deviated: bool) -> Scenario {
    Scenario::assemble(parts(i, deviated)).unwrap()
}

/// As [`deviating`], in parts.
pub(crate) fn parts(i: usize, deviated: bool) -> ScenarioParts {
    let speed = 6.0 + (i % 7) as f64;
    let gap = 9.0 + (i % 5) as f64;
    let road = |y: f64, right: bool| {
        let (from, to) = if right { (-300.0, 300.0) } else { (300.0, -300.0) };
        RoadEdge { kind: RoadEdgeKind::Boundary, points: vec![Vec2::new(from, y), Vec2::new(to, y)] }
    };
    let lane = |id: &str, y: f64| LaneParts {
        id: id.to_owned(),
        speed_limit: Some(13.4),
        points: (-30..=30).map(|k| Vec2::new(10.0 * f64::from(k), y)).collect(),
        ..LaneParts::default()
    };
    let braking: Vec<Frame> = (1..=FUTURE)
        .map(|k| {
            let t = (k as f64 * 0.1).min(speed / 4.0);
            let (x, v) = (speed * t - 2.0 * t * t, speed - 4.0 * t);
            Some(AgentState { x, y: 0.0, heading: 0.0, vx: v, vy: 0.0 })
        })
        .collect();
    assert_eq!(HISTORY + braking.len(), FRAMES);
    ScenarioParts {
        id: format!("road-{i:03}"),
        source: "generated".to_owned(),
        agents: vec![
            driver("av", 0.0, 0.0, speed),
            driver("behind", -gap, 0.0, speed),
            driver("ahead", 3.0 * gap, 0.0, speed),
            driver("beside", -2.0, 3.5, speed + 1.0),
        ],
        map: MapParts {
            lanes: vec![lane("right", 0.0), lane("left", 3.5)],
            road_edges: vec![road(-1.75, true), road(5.25, false)],
            ..MapParts::default()
        },
        deviation: deviated.then(|| DeviationParts {
            category: Some(Deviation::ALL[i % 3]),
            track: braking,
            certificate: None,
        }),
        ..ScenarioParts::default()
    }
}

/// Returns scenario `i` with a certificate: the follower brakes too, 0.3 s after the AV. Difficulties take
/// turns: easy, medium, hard.
pub(crate) fn certified(i: usize) -> Scenario {
    let mut parts = parts(i, true);
    let (follower, reaction, deceleration) = (&parts.agents[1].track, 3, 4.5);
    let begin = follower[HISTORY - 1 + reaction].unwrap();
    let state = |k: usize| {
        let Some(t) = k.checked_sub(reaction) else { return follower[HISTORY - 1 + k].unwrap() };
        let t = (t as f64 * 0.1).min(begin.vx / deceleration);
        AgentState {
            x: begin.x + begin.vx * t - 0.5 * deceleration * t * t,
            vx: begin.vx - deceleration * t,
            ..begin
        }
    };
    let response = Response {
        agent: "behind".to_owned(),
        leader: None,
        reaction_step: reaction,
        nudge: 0.0,
        peak_deceleration: deceleration,
        clearance: 1.0,
        effort: Some(Effort { required_deceleration: [1.0, 2.0, 4.0][i % 3], time_to_react: 3.0 }),
        track: (0..=FUTURE).map(state).collect(),
    };
    if let Some(deviation) = &mut parts.deviation {
        deviation.certificate = Some(Certificate { responses: vec![response] });
    }
    Scenario::assemble(parts).unwrap()
}

/// Returns a source that makes its scenarios again each time it is opened.
pub(crate) fn source(name: &str, scenarios: Vec<usize>) -> Source {
    source_of(name, scenarios, scenario)
}

/// As [`source`], with scenarios of another rule.
pub(crate) fn source_of(name: &str, scenarios: Vec<usize>, make: fn(usize) -> Scenario) -> Source {
    Source {
        count: Some(scenarios.len()),
        file: FileRecord { name: name.to_owned(), format: "generated".into(), ..FileRecord::default() },
        open: Box::new(move |first| {
            let scenarios = scenarios.clone();
            Ok(Box::new(scenarios.into_iter().skip(first).map(move |i| Ok(decoded(make(i))))))
        }),
    }
}

/// Returns the plan of a run with default settings.
pub(crate) fn plan(sources: Vec<Source>, simulators: Vec<PlannedSimulator>) -> Plan {
    let mut spec = RunSpec::default();
    spec.subject.av = Some(AvChoice::Deviated);
    spec.plan(RunParts { sources, simulators, ..RunParts::default() }).unwrap()
}

pub(crate) fn write<S: Borrow<Scenario>>(path: &Path, scenarios: impl IntoIterator<Item = S>) {
    let mut writer = Writer::create(path).unwrap();
    for scenario in scenarios {
        writer.write(scenario.borrow()).unwrap();
    }
    writer.finish().unwrap();
}
