//! Tests of scenarios with two levels, and of other lengths.

use reactsim_rollout::{Purpose, stream};
use reactsim_scene::{AgentKind, CURRENT, DT, FRAMES, Frame, Length, Scenario};

use crate::maps::{self, MAP_TYPES, ON_REQUEST};
use crate::traffic::{Manner, record};
use crate::{GenerationSettings, Generator, Preset};

/// Number of scenarios per preset.
const SCENARIOS: u64 = 6;

fn overpasses() -> Vec<Scenario> {
    let of = |preset| {
        let settings =
            GenerationSettings { preset, maps: vec!["overpass".to_owned()], ..GenerationSettings::default() };
        let generator = Generator::new(settings).unwrap();
        (0..SCENARIOS).map(move |number| generator.scenario(number).unwrap())
    };
    Preset::ALL.into_iter().flat_map(of).collect()
}

/// Returns the recorded height of an agent at a frame, metres.
fn height(scenario: &Scenario, agent: usize, frame: usize) -> Option<f64> {
    let (start, future) = (&scenario.start.heights[agent], &scenario.log_future.heights[agent]);
    start.iter().chain(future).nth(frame).copied().flatten()
}

#[test]
fn bridges_are_a_second_level_with_traffic_on_both() {
    let (mut raised, mut low) = (0, 0);
    for scenario in overpasses() {
        assert_eq!(
            (scenario.levels(), scenario.source.as_str()),
            (2, "generated/overpass"),
            "{}",
            scenario.id
        );
        assert!(scenario.repairs.is_empty(), "{}: {:?}", scenario.id, scenario.repairs);
        let agents = scenario.start.agents.iter().enumerate();
        for (i, a) in agents.filter(|(_, a)| a.kind == AgentKind::Vehicle) {
            let moves = scenario.start.now(i).speed() > 1.0;
            match height(&scenario, i, CURRENT) {
                Some(z) if z > 3.0 && moves => raised += 1,
                Some(z) if z < 0.1 && moves => low += 1,
                Some(_) => {}
                None => panic!("{}: {} has no height", scenario.id, a.id),
            }
        }
    }
    assert!(raised > 20 && low > 20, "{raised} vehicles on bridges, {low} below");
}

#[test]
fn heights_of_agents_are_those_of_their_roads() {
    for scenario in overpasses() {
        for (i, agent) in scenario.start.agents.iter().enumerate() {
            let mut last: Option<f64> = None;
            for f in 0..FRAMES {
                let state = scenario.logged_at(i, f);
                let z = height(&scenario, i, f);
                assert_eq!(z.is_some(), state.is_some(), "{}: {} at frame {f}", scenario.id, agent.id);
                let (Some(state), Some(z)) = (state, z) else {
                    last = None;
                    continue;
                };
                if let Some(last) = last {
                    let step = 0.051 * state.speed() * DT + 0.01;
                    assert!((z - last).abs() <= step, "{}: {} jumps to {z} m", scenario.id, agent.id);
                }
                last = Some(z);
                // Vehicles off the road are not on the nearest lane or edge.
                let road = scenario.start.road().on_level(state.position(), z);
                if road.drivable(state.position(), &mut None) == Some(true) {
                    let ground = scenario.start.road().ground_height(state.position(), z);
                    let id = &agent.id;
                    assert!((z - ground).abs() < 0.3, "{}: {id} at {z} m, ground {ground} m", scenario.id);
                }
            }
        }
    }
}

#[test]
fn maps_on_request_are_drawn_only_by_id() {
    let settings = |maps: &[&str]| GenerationSettings {
        maps: maps.iter().map(|&id| id.to_owned()).collect(),
        ..GenerationSettings::default()
    };
    let drawn = |maps: &[&str]| settings(maps).map_types().iter().map(|m| m.id).collect::<Vec<_>>();
    assert_eq!(drawn(&[]), MAP_TYPES.iter().map(|m| m.id).collect::<Vec<_>>());
    assert_eq!(drawn(&["overpass", "on-ramp"]), ["on-ramp", "overpass"]);
    for kind in ON_REQUEST {
        assert!(maps::find(kind.id).is_some() && !drawn(&[]).contains(&kind.id));
    }
    let error = Generator::new(settings(&["moon"])).unwrap_err().to_string();
    assert!(error.ends_with(", overpass"), "{error}");
}

/// Returns whether a vehicle enters the map after frame 90.
fn is_late((agent, track): &(reactsim_scene::Agent, Vec<Frame>)) -> bool {
    agent.kind == AgentKind::Vehicle && track[..FRAMES].iter().all(Option::is_none)
}

#[test]
fn longer_recordings_begin_as_shorter_ones_and_vehicles_keep_arriving() {
    for kind in MAP_TYPES {
        let layout = kind.layout(&mut stream(0, kind.id, 0, Purpose::Map));
        let traffic = |future| {
            let length = Length { history: 11, future };
            record(&layout, 1.0, Manner::CALM, length, &mut stream(0, kind.id, 0, Purpose::Traffic))
        };
        let (short, long) = (traffic(80), traffic(600));
        assert_eq!(long.length.frames(), 611);
        assert!(long.lights.iter().all(|states| states.len() == 611));
        for (one, states) in short.lights.iter().zip(&long.lights) {
            assert_eq!(one[..], states[..FRAMES]);
        }
        for (agent, track) in &short.agents {
            let (_, longer) = long.agents.iter().find(|(other, _)| other.id == agent.id).unwrap();
            assert_eq!((longer.len(), &longer[..FRAMES]), (611, &track[..]), "{}: {}", kind.id, agent.id);
        }
        let late = long.agents.iter().filter(|agent| is_late(agent)).count();
        assert!(late > 0, "{}: nobody arrives", kind.id);
        // There is traffic to the end.
        let last = long.agents.iter().filter(|(agent, track)| {
            let moves = track[610].zip(track[600]).is_some_and(|(a, b)| a.position() != b.position());
            agent.kind == AgentKind::Vehicle && moves
        });
        assert!(last.count() > 0, "{}: nobody drives at the end", kind.id);
    }
}

#[test]
fn scenarios_have_the_requested_length() {
    for length in [
        Length { history: 2, future: 60 },
        Length { history: 21, future: 150 },
        Length { history: 100, future: 200 },
    ] {
        for preset in Preset::ALL {
            let settings = GenerationSettings { preset, length, ..GenerationSettings::default() };
            let scenario = Generator::new(settings).unwrap().scenario(1).unwrap();
            assert_eq!((scenario.length(), scenario.timestamps.len()), (length, length.frames()));
            assert!(scenario.logged(0).iter().all(Option::is_some), "the AV is there all the time");
            assert!(scenario.start.agents.len() > 1 && scenario.repairs.is_empty());
        }
    }
    for length in [
        Length { history: 1, future: 80 },
        Length { history: 101, future: 80 },
        Length { history: 11, future: 0 },
        Length { history: 11, future: 6001 },
    ] {
        let error =
            Generator::new(GenerationSettings { length, ..GenerationSettings::default() }).unwrap_err();
        let Length { history, future } = length;
        assert_eq!(
            error.to_string(),
            format!("{history} frames of history and {future} after them: expected 2 to 100, and 1 to 6000")
        );
    }
}
