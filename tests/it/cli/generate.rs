//! `reactsim generate` as its user sees it, and properties of presets.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Command;

use reactsim::curation::{PROPORTIONS, in_proportion, store};
use reactsim::formats;
use reactsim::generation::{GenerationSettings, Generator, Preset};
use reactsim::rollout::{Purpose, stream};

use crate::program::{program, reactsim};

fn text(bytes: &[u8]) -> &str {
    std::str::from_utf8(bytes).unwrap()
}

fn path(path: &Path) -> &str {
    path.to_str().unwrap()
}

#[test]
fn wrong_settings_are_refused_by_name() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a.parquet");
    let error = |arguments: &[&str]| {
        let output = reactsim(&[&["generate"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(output.stdout.is_empty(), "{arguments:?} printed a result");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0, "{arguments:?} left a file");
        text(&output.stderr).replace(path(home.path()), "HOME")
    };
    let with =
        |more: &[&str]| error(&[&["--preset", "train", "--count", "2", "--out", path(&out)], more].concat());
    let unknown = error(&["--preset", "test", "--count", "2", "--out", path(&out)]);
    assert!(unknown.contains("'test'") && unknown.contains("bench, train"), "{unknown}");
    for count in ["0", "-1", "many"] {
        let said = error(&["--preset", "train", "--count", count, "--out", path(&out)]);
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
        let said = error(&["--preset", preset, "--count", "100", "--out", path(&absent)]);
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
        let output = reactsim(&[
            "generate",
            "--preset",
            "train",
            "--count",
            "20",
            "--seed",
            "3",
            "--out",
            path(&out),
            "--jobs",
            jobs,
        ]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        made.push((fs::read(&out).unwrap(), output.stdout));
    }
    assert!(made[0] == made[1]);
    let manifest: toml::Table = text(&made[0].1).parse().unwrap();
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

#[test]
fn a_small_benchmark_is_what_was_asked_for() {
    let home = tempfile::tempdir().unwrap();
    let maps = ["priority-t", "signalised-permissive"];
    let make = |jobs: &str| {
        let folder = home.path().join(jobs);
        fs::create_dir(&folder).unwrap();
        let out = folder.join("bench.parquet");
        let output = reactsim(&[
            "generate",
            "--preset",
            "bench",
            "--count",
            "6",
            "--maps",
            &maps.join(","),
            "--out",
            path(&out),
            "--jobs",
            jobs,
        ]);
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        let beside = out.with_extension("deviations.parquet");
        (fs::read(&out).unwrap(), fs::read(beside).unwrap(), output.stdout)
    };
    let made = make("1");
    assert!(made == make("3"), "the threads decide");
    let manifest: toml::Table = text(&made.2).parse().unwrap();
    let files = manifest["made"][0]["files"].as_array().unwrap();
    let digests: Vec<_> = files.iter().map(|f| f["blake3"].as_str().unwrap()).collect();
    assert_eq!(digests, [&made.0, &made.1].map(|b| blake3::hash(b).to_hex().to_string()));

    let file = home.path().join("1/bench.parquet");
    let scenarios: Vec<_> = formats::open(&file).unwrap().map(Result::unwrap).collect();
    let records = store::read(home.path().join("1/bench.deviations.parquet")).unwrap();
    let mut categories = BTreeMap::new();
    for (scenario, record) in scenarios.iter().zip(records) {
        let (deviation, record) = (scenario.deviation.as_ref().unwrap(), record.unwrap());
        *categories.entry(deviation.category.unwrap()).or_insert(0) += 1;
        assert_eq!((&record.scenario_id, &record.scenario_digest), (&scenario.id, &scenario.digest()));
        let [chosen] = record.candidates.as_slice() else { panic!("{}: one candidate", scenario.id) };
        assert!(chosen.chosen && chosen.certificate.is_some());
        assert_eq!(chosen.candidate.track[1..], deviation.track);
    }
    assert_eq!(categories, in_proportion(6, &PROPORTIONS));
    let of = |id: &str| scenarios.iter().filter(|s| s.source == format!("generated/{id}")).count();
    assert!(of(maps[0]) > 0 && of(maps[0]) + of(maps[1]) == 6, "{} of {}", of(maps[0]), maps[0]);

    // The file can be run as it is.
    let run = reactsim(&["run", path(&file), "--models", "stop"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
}

#[cfg(unix)]
#[test]
fn interrupted_it_leaves_what_is_finished() {
    use std::process::Stdio;
    use std::time::Duration;

    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("a.parquet");
    let partial = |wanted: u64| {
        let entries = fs::read_dir(home.path()).unwrap();
        entries.filter_map(|e| e.ok()?.metadata().ok()).any(|m| m.len() >= wanted)
    };
    let child = program()
        .args(["generate", "--preset", "train", "--count", "1000000", "--jobs", "1", "--out", path(&out)])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // A row group has been written, so there are scenarios.
    for _ in 0..1200 {
        if partial(10_000) {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
    }
    Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let output = child.wait_with_output().unwrap();
    assert_eq!(output.status.code(), Some(130), "{}", text(&output.stderr));
    let (said, part) = (text(&output.stderr), home.path().join("a.interrupted.parquet"));
    assert!(said.contains(&format!("interrupted: {} has the first ", path(&part))), "{said}");
    assert!(said.contains(&format!("{} was not written", path(&out))) && !out.exists(), "{said}");
    assert!(output.stdout.is_empty(), "what is not whole cannot be made again by the command");
    let scenarios: Vec<_> = formats::open(&part).unwrap().map(|s| s.unwrap().id).collect();
    assert!(!scenarios.is_empty());
    let settings = GenerationSettings { preset: Preset::Train, ..GenerationSettings::default() };
    assert!(scenarios.iter().zip(0..).all(|(id, n)| *id == settings.id(n)));
}
