//! Effects of settings.

use rayon::prelude::*;
use reactsim::generation::maps::MAP_TYPES;
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::scene::Scenario;

use super::sample::{Generated, sample};

fn made(settings: &GenerationSettings, numbers: std::ops::Range<u64>) -> Vec<Scenario> {
    let generator = Generator::new(settings.clone()).unwrap();
    numbers.into_par_iter().map(|n| generator.scenario(n).unwrap()).collect()
}

#[test]
fn density_changes_the_number_of_agents() {
    let moving = |density| {
        let maps = ["straight-road", "signalised-permissive", "priority-t"].map(str::to_owned).to_vec();
        let settings =
            GenerationSettings { preset: Preset::Train, maps, density: Some(density), ..Default::default() };
        let agents = made(&settings, 0..8).into_iter().flat_map(|s| s.start.agents);
        agents.filter(|a| !a.id.starts_with("parked-")).count()
    };
    let [few, some, many] = [0.1, 0.5, 1.2].map(moving);
    assert!(few * 2 < some && some * 3 < many * 2, "{few}, {some}, {many} agents");
}

#[test]
fn only_the_maps_that_are_asked_for_are_drawn() {
    for preset in Preset::ALL {
        let maps = ["on-ramp", "narrow-street"].map(str::to_owned).to_vec();
        let settings = GenerationSettings { preset, maps, ..Default::default() };
        let sources: Vec<String> = made(&settings, 0..8).into_iter().map(|s| s.source).collect();
        let of = |id: &str| sources.iter().filter(|s| **s == format!("generated/{id}")).count();
        assert_eq!(of("on-ramp") + of("narrow-street"), 8, "{sources:?}");
        if preset == Preset::Bench {
            assert_eq!(of("on-ramp"), 4, "benchmarks take them in turn");
        }
    }
}

#[test]
fn benchmarks_take_map_types_in_turn_and_have_an_av_that_drives() {
    let bench: Vec<&Generated> =
        sample().iter().filter(|g| g.scenario.id.starts_with(Preset::Bench.name())).collect();
    for (generated, kind) in bench.iter().zip(MAP_TYPES.iter().cycle()) {
        let scenario = &generated.scenario;
        assert_eq!(scenario.source, format!("generated/{}", kind.id), "{}", scenario.id);
        let way = (scenario.logged_at(0, 90).unwrap().position() - scenario.start.now(0).position()).norm();
        assert!(way >= 9.9, "{}: the AV drives {way} m", scenario.id);
    }
}

#[test]
fn scenarios_are_whole() {
    for Generated { scenario, everybody } in sample() {
        assert!(scenario.repairs.is_empty(), "{}: {:?}", scenario.id, scenario.repairs);
        assert!(scenario.log_future.tracks[0].iter().all(Option::is_some), "{}: the AV leaves", scenario.id);
        assert!(scenario.start.agents.len() <= 64 && scenario.deviation.is_none());
        let states = everybody.iter().flat_map(|a| a.track.iter().flatten());
        assert!(states.clone().all(|s| s.is_finite() && s.velocity().is_some()), "{}", scenario.id);
        let lights = (0..scenario.start.lights.len()).flat_map(|l| scenario.light_states(l));
        assert!(lights.clone().all(|s| s.is_some()), "{}: a light shows nothing", scenario.id);
    }
}
