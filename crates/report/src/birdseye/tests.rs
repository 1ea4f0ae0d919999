use reactsim_geometry::Polygon;
use reactsim_scene::{
    Agent, AgentKind, AgentState, CURRENT, Crosswalk, FRAMES, LaneParts, Length, LightParts, LightState,
    LoggedAgent, MapParts, RoadEdge, RoadEdgeKind, ScenarioParts,
};
use resvg::usvg::roxmltree::Document;

use super::*;

/// Checks that a picture is XML without control characters.
fn check_xml(text: &str) {
    Document::parse(text).unwrap();
    assert!(!text.contains(|c: char| c < ' ' && c != '\n'), "a control character");
}

fn moving(id: &str, kind: AgentKind, from: Vec2, speed: f64, length: Length) -> LoggedAgent {
    let state = |k: usize| {
        let x = from.x + speed * DT * (k as f64 - length.current() as f64);
        Some(AgentState { x, y: from.y, heading: 0.0, vx: speed, vy: 0.0 })
    };
    LoggedAgent {
        agent: Agent { id: id.into(), kind, length: 4.0, width: 2.0 },
        track: (0..length.frames()).map(state).collect(),
        heights: Vec::new(),
    }
}

fn tiny() -> ScenarioParts {
    let lane = LaneParts {
        id: "east".into(),
        points: vec![Vec2::new(-900.0, 0.0), Vec2::new(900.0, 0.0)],
        ..LaneParts::default()
    };
    let agent = |id: &str, kind, from, speed| moving(id, kind, from, speed, Length::BENCHMARK);
    ScenarioParts {
        id: "tiny".into(),
        agents: vec![
            agent("ego", AgentKind::Vehicle, Vec2::zeros(), 5.0),
            agent("walker", AgentKind::Pedestrian, Vec2::new(8.0, 4.0), 1.0),
            agent("far", AgentKind::Vehicle, Vec2::new(500.0, 0.0), 1.0),
        ],
        map: MapParts {
            lanes: vec![lane],
            road_edges: vec![RoadEdge {
                kind: RoadEdgeKind::Boundary,
                points: vec![Vec2::new(-900.0, -1.75), Vec2::new(900.0, -1.75)],
            }],
            crosswalks: vec![Crosswalk {
                outline: vec![
                    Vec2::new(10.0, -2.0),
                    Vec2::new(13.0, -2.0),
                    Vec2::new(13.0, 2.0),
                    Vec2::new(10.0, 2.0),
                ],
            }],
            ..MapParts::default()
        },
        lights: vec![LightParts {
            lane: "east".into(),
            stop_point: Vec2::new(9.0, 0.0),
            states: vec![Some(LightState::Stop); FRAMES],
        }],
        ..ScenarioParts::default()
    }
}

fn view() -> View<'static> {
    View { radius: 20.0, size: 200.0, ..View::default() }
}

#[test]
fn a_tiny_scene_looks_as_agreed() {
    let scenario = Scenario::assemble(tiny()).unwrap();
    let svg = draw(&scenario, &view());
    check_xml(&svg);
    assert!(!svg.contains("far"), "agents outside the view are not written");
    insta::assert_snapshot!(svg);
}

#[test]
fn hostile_names_are_escaped() {
    let mut parts = tiny();
    parts.id = "a<b>&\"c']]>".into();
    parts.agents[1].agent.id = "</text><script>alert('&')</script>".into();
    let scenario = Scenario::assemble(parts).unwrap();
    let svg = draw(&scenario, &view());
    check_xml(&svg);
    assert!(!svg.contains("<script"));
    let title = Some("<![CDATA[ & \u{0}\u{1b}]]>".to_owned());
    check_xml(&draw(&scenario, &View { title, ..view() }));
}

#[test]
fn an_empty_map_and_a_lonely_av_are_drawn() {
    let mut parts = tiny();
    (parts.map, parts.lights) = (MapParts::default(), Vec::new());
    parts.agents.truncate(1);
    let scenario = Scenario::assemble(parts).unwrap();
    for steps in [vec![], vec![0], vec![0, 20, 40, 60, 80], vec![900]] {
        check_xml(&draw(&scenario, &View { steps, ..view() }));
    }
    let svg = draw(&scenario, &View { radius: f64::NAN, size: f64::INFINITY, ..view() });
    check_xml(&svg);
    assert!(!svg.contains("NaN") && !svg.contains("inf"));
}

#[test]
fn a_rollout_shows_ghosts_and_marks() {
    let mut parts = tiny();
    parts.map.drivable_area = Some(vec![Polygon {
        exterior: vec![
            Vec2::new(-50.0, -9.0),
            Vec2::new(90.0, -9.0),
            Vec2::new(90.0, 9.0),
            Vec2::new(-50.0, 9.0),
        ],
        holes: vec![vec![Vec2::new(0.0, 5.0), Vec2::new(3.0, 5.0), Vec2::new(3.0, 7.0)]],
    }]);
    let scenario = Scenario::assemble(parts).unwrap();
    let mut tracks: Vec<Vec<Frame>> = (0..3).map(|i| scenario.logged(i)).collect();
    let before = draw(&scenario, &View { rollout: Some(&tracks), steps: vec![30], ..view() });
    tracks[1].iter_mut().skip(CURRENT + 1).flatten().for_each(|s| s.y += 2.0);
    tracks[2].truncate(CURRENT + 5);
    let marks = [MarkKind::AtFault, MarkKind::Contact, MarkKind::Risky, MarkKind::OffRoad];
    let mark = |kind| Mark { agent: "walker".into(), step: 20, kind };
    let mut marks: Vec<Mark> = marks.into_iter().map(mark).collect();
    marks.push(Mark { agent: "nobody".into(), step: 20, kind: MarkKind::Risky });
    let after = draw(&scenario, &View { rollout: Some(&tracks), steps: vec![30], marks, ..view() });
    check_xml(&before);
    check_xml(&after);
    let dashed = |svg: &str| svg.matches("stroke-dasharray").count();
    assert!(dashed(&after) > dashed(&before), "a ghost appears where the rollout leaves the log");
    assert!(after.contains("#ffd34d"), "a risky moment is marked");
}

#[test]
fn nothing_outside_the_view_is_written() {
    let scenario = Scenario::assemble(tiny()).unwrap();
    let svg = draw(&scenario, &view());
    let numbers = svg.split("d=\"M").skip(1).filter_map(|d| d.split('"').next());
    for number in numbers.flat_map(|d| d.split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))) {
        let Ok(value) = number.parse::<f64>() else { continue };
        assert!((-60.0..400.0).contains(&value), "{value}");
    }
}

#[test]
fn steps_of_any_length_are_drawn() {
    for (history, future) in [(2, 60), (11, 150), (21, 600)] {
        let length = Length { history, future };
        let parts = ScenarioParts { id: "long".into(), length, ..ScenarioParts::default() };
        let agents = vec![moving("ego", AgentKind::Vehicle, Vec2::zeros(), 5.0, length)];
        let scenario = Scenario::assemble(ScenarioParts { agents, ..parts }).unwrap();
        let last = draw(&scenario, &View { steps: vec![future], ..view() });
        check_xml(&last);
        assert!(last.contains(&format!("step {future} ·")));
        assert_eq!(last, draw(&scenario, &View { steps: vec![usize::MAX], ..view() }));
        let mut tracks = vec![scenario.logged(0)];
        tracks[0][length.frames() - 1].as_mut().unwrap().y = 3.0;
        let view = View { rollout: Some(&tracks), steps: vec![future], ..view() };
        assert!(
            draw(&scenario, &view).contains("stroke-dasharray"),
            "the last step is compared with the log"
        );
    }
}
