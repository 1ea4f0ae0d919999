//! A number always gives the same scenario.

use rayon::prelude::*;
use reactsim::generation::{GenerationSettings, Generator, Preset, VERSION};

/// Scenarios by preset, seed and number, with the beginnings of their digests; for this version of the
/// generator.
const GOLDEN: (u32, [(&str, &str); 10]) = (
    2,
    [
        ("bench-0-000000", "d2c8f3f1a25309a9"),
        ("bench-0-000011", "59c0e90288aeeda6"),
        ("bench-0-000019", "1aff95f1ecce7f88"),
        ("bench-7-001020", "6bc73fc4fbb68a96"),
        ("train-0-000000", "9732d04ec729267e"),
        ("train-0-000001", "80342a9b103648b1"),
        ("train-0-000002", "9ade4c60c187264a"),
        ("train-7-123456", "674900d15bafbff5"),
        ("sensed-7-000000", "5e554f8576a00d38"),
        ("sensed-7-000005", "1f4749092ecf6470"),
    ],
);

fn generator(preset: Preset, seed: u64) -> Generator {
    Generator::new(GenerationSettings { preset, seed, ..GenerationSettings::default() }).unwrap()
}

/// Returns the beginning of the digest of the scenario with this id.
fn digest(id: &str) -> String {
    let parts: Vec<&str> = id.split('-').collect();
    let preset = Preset::from_name(parts[0]).unwrap();
    let scenario = generator(preset, parts[1].parse().unwrap()).scenario(parts[2].parse().unwrap()).unwrap();
    assert_eq!(scenario.id, id);
    scenario.digest()[..16].to_owned()
}

#[test]
fn numbers_are_the_scenarios_that_they_were() {
    let (version, expected) = GOLDEN;
    let found = expected.map(|(id, _)| (id, digest(id)));
    if found.iter().zip(expected).all(|(a, b)| a.1 == b.1) && version == VERSION {
        return;
    }
    let lines: String = found.iter().map(|(id, d)| format!("        (\"{id}\", \"{d}\"),\n")).collect();
    panic!(
        "other scenarios than before: raise generation::VERSION unless it was raised, make the files of scenarios/manifest.toml \
         again, and put this table into {}, with the version:\n{lines}",
        file!()
    );
}

/// A scenario does not depend on those generated before or at the same time.
#[test]
fn a_scenario_does_not_know_the_others() {
    for preset in Preset::ALL {
        let all = generator(preset, 3);
        let digest = |generator: &Generator, number| generator.scenario(number).unwrap().digest();
        let together: Vec<String> = (0..8).into_par_iter().map(|n| digest(&all, n)).collect();
        for number in [7, 4, 0] {
            assert_eq!(together[number as usize], digest(&generator(preset, 3), number), "{number}");
        }
        assert!((1..8).all(|n| together[n] != together[n - 1]));
    }
}
