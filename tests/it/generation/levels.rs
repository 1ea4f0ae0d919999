//! Generated bridges: two levels that do not meet.

use std::sync::LazyLock;

use reactsim::formats;
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::rollout::Settings;
use reactsim::scene::{MapHeights, Scenario};

use crate::scenes::{roll_with, scores};
use crate::small_scenarios::write;

static OVERPASSES: LazyLock<Vec<Scenario>> = LazyLock::new(|| {
    let settings = GenerationSettings {
        preset: Preset::Bench,
        maps: vec!["overpass".to_owned()],
        ..GenerationSettings::default()
    };
    let generator = Generator::new(settings).unwrap();
    (0..8).map(|number| generator.scenario(number).unwrap()).collect()
});

/// Returns the scenario on one level, as a file without heights would have it.
fn flattened(scenario: &Scenario) -> Scenario {
    let mut flat = scenario.clone();
    flat.start.map.edit().heights = MapHeights::default();
    flat.start.heights.clear();
    flat.start.obstacle_heights.clear();
    flat.log_future.heights.clear();
    flat.unselected.iter_mut().for_each(|a| a.heights.clear());
    flat
}

#[test]
fn bridges_have_two_levels_that_files_keep() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("overpass.parquet");
    write(&path, OVERPASSES.iter());
    let back: Vec<Scenario> = formats::open(&path).unwrap().map(Result::unwrap).collect();
    assert_eq!(back.len(), OVERPASSES.len());
    for (scenario, back) in OVERPASSES.iter().zip(&back) {
        assert_eq!((scenario.source.as_str(), scenario.levels()), ("generated/overpass", 2));
        assert_eq!(scenario.digest(), back.digest());
        assert_eq!(scenario.start.map.heights, back.start.map.heights);
    }
}

#[test]
fn logs_on_two_levels_are_faultless() {
    let mut flat_overlaps = 0.0;
    for scenario in OVERPASSES.iter() {
        let av: Vec<_> = scenario.log_future.tracks[0].iter().map(|s| s.unwrap()).collect();
        let values = |scenario: &Scenario| {
            let rollout = roll_with("log-replay", scenario, av.clone(), &Settings::default(), 0);
            let scores = scores(scenario, &rollout);
            ["aav-collision", "aa-collision", "offroad"].map(|id| scores.value(id).unwrap_or(0.0))
        };
        assert_eq!(values(scenario), [0.0; 3], "{}", scenario.id);
        flat_overlaps += values(&flattened(scenario)).iter().sum::<f64>();
    }
    assert!(flat_overlaps > 0.0, "on one level the same traffic collides");
}
