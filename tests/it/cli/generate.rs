//! `reactsim generate` as its user sees it, and properties of presets.

use std::collections::BTreeMap;
use std::fs;

use reactsim::formats;
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::rollout::{Purpose, stream};

use crate::program::{program, refused, said, signalled, stderr, text};

#[test]
fn wrong_settings_are_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a.parquet");
    let error = |arguments: &[&str]| {
        let error = refused(&[&["generate"], arguments].concat());
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0, "{arguments:?} left a file");
        error.replace(text(home.path()), "HOME")
    };
    let with =
        |more: &[&str]| error(&[&["--preset", "train", "--count", "2", "--out", text(&out)], more].concat());
    let unknown = error(&["--preset", "test", "--count", "2", "--out", text(&out)]);
    assert!(unknown.contains("'test'") && unknown.contains("bench, train"), "{unknown}");
    for count in ["0", "-1", "many"] {
        let said = error(&["--preset", "train", "--count", count, "--out", text(&out)]);
        assert!(said.contains(&format!("'{count}'")) && said.contains("--count"), "{said}");
    }
    assert!(with(&["--maps", "moon"]).starts_with("error: no map type `moon`; available: "));
    for density in ["0", "NaN", "4", "-1", "inf"] {
        let said = with(&["--density", density]);
        let expected = format!("error: density {density}: expected a number above 0 and at most 3\n");
        assert_eq!(said, expected);
    }
    assert!(with(&["--density", "dense"]).contains("--density"));
    assert!(with(&["--jobs", "0"]).contains("1..=1024"));
    assert!(error(&[]).contains("--preset"), "{}", error(&[]));
    assert!(error(&["--preset", "train", "--count", "2"]).contains("--out"));
    for preset in ["bench", "train"] {
        let absent = home.path().join("absent/a.parquet");
        let said = error(&["--preset", preset, "--count", "100", "--out", text(&absent)]);
        assert!(said.starts_with("error: HOME/absent/a.parquet: could not create"), "{said}");
    }
}

#[test]
fn presets_never_share_a_scenario() {
    let settings = |preset, seed| GenerationSettings { preset, seed, ..GenerationSettings::default() };
    let mut bits = BTreeMap::new();
    for preset in Preset::ALL {
        for seed in [0, 1, 10, u64::MAX] {
            for number in [0, 1, 10, 999_999, 1_000_000, 10_000_000] {
                let id = settings(preset, seed).id(number);
                // The name of the preset comes first, and no name is the beginning of another.
                assert!(id.starts_with(&format!("{}-{seed}-", preset.name())), "{id}");
                for purpose in [Purpose::Map, Purpose::Traffic] {
                    use rand::RngExt;
                    let first: [u64; 2] = stream(seed, &id, 0, purpose).random();
                    let other = bits.insert(first, (id.clone(), purpose as u64));
                    assert_eq!(other, None, "{id} draws as another scenario");
                }
            }
        }
    }
    let names = Preset::ALL.map(Preset::name);
    for (i, a) in names.iter().enumerate() {
        assert!(!a.contains('-') && names[..i].iter().all(|b| !a.starts_with(b) && !b.starts_with(a)), "{a}");
    }
}

#[test]
fn files_are_the_same_whatever_the_threads() {
    let home = tempfile::tempdir().unwrap();
    let mut made = Vec::new();
    for jobs in ["1", "3"] {
        let folder = home.path().join(jobs);
        fs::create_dir(&folder).unwrap();
        let out = folder.join("train.parquet");
        let asked = ["generate", "--preset", "train", "--count", "20", "--seed", "3", "--jobs", jobs];
        let (manifest, _) = said(&[&asked[..], &["--out", text(&out)]].concat(), 0);
        made.push((fs::read(&out).unwrap(), manifest));
    }
    assert!(made[0] == made[1]);
    let manifest: toml::Table = made[0].1.parse().unwrap();
    let entry = &manifest["made"][0];
    let digest = blake3::hash(&made[0].0).to_hex();
    assert_eq!(entry["files"][0]["blake3"].as_str(), Some(digest.as_str()));
    assert_eq!(
        entry["command"].as_str(),
        Some("reactsim generate --preset train --count 20 --seed 3 --out train.parquet")
    );
    // The file has the scenarios of these numbers.
    let settings = GenerationSettings { preset: Preset::Train, seed: 3, ..GenerationSettings::default() };
    let generator = Generator::new(settings.clone()).unwrap();
    let read = formats::open(&home.path().join("1/train.parquet")).unwrap();
    for (number, scenario) in (0..).zip(read) {
        let scenario = scenario.unwrap();
        assert_eq!(scenario.id, settings.id(number));
        assert!(scenario.deviation.is_none());
        if number % 5 == 0 {
            assert_eq!(scenario.digest(), generator.scenario(number).unwrap().digest());
        }
    }
}

#[cfg(unix)]
#[test]
fn interrupted_it_leaves_what_is_finished() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a.parquet");
    // As soon as a row group is written, there are scenarios.
    let has_scenarios = || {
        let entries = fs::read_dir(home.path()).unwrap();
        entries.filter_map(|e| e.ok()?.metadata().ok()).any(|m| m.len() >= 10_000)
    };
    let mut command = program();
    command.args(["generate", "--preset", "train", "--count", "1000000", "--jobs", "1", "--out", text(&out)]);
    let output = signalled(&mut command, "-INT", has_scenarios);
    let (said, part) = (stderr(&output), home.path().join("a.interrupted.parquet"));
    assert_eq!(output.status.code(), Some(130), "{said}");
    assert!(said.contains(&format!("interrupted: {} has the first ", text(&part))), "{said}");
    assert!(said.contains(&format!("{} was not written", text(&out))) && !out.exists(), "{said}");
    assert!(output.stdout.is_empty(), "what is not whole cannot be made again by the command");
    let scenarios: Vec<_> = formats::open(&part).unwrap().map(|s| s.unwrap().id).collect();
    assert!(!scenarios.is_empty());
    let settings = GenerationSettings { preset: Preset::Train, ..GenerationSettings::default() };
    assert!(scenarios.iter().zip(0..).all(|(id, n)| *id == settings.id(n)));
}
