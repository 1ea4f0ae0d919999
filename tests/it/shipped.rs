//! The files that ship with the program are those of `scenarios/manifest.toml`, and have the properties that
//! they promise.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

use reactsim::curation::{DIFFICULTIES, PROPORTIONS, in_proportion, store};
use reactsim::formats;
use reactsim::generation::VERSION;
use reactsim::generation::maps::MAP_TYPES;
use reactsim::scene::Scenario;
use toml::{Table, Value};

use crate::program::{program, words};

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("scenarios")
}

fn manifest() -> Table {
    fs::read_to_string(folder().join("manifest.toml")).unwrap().parse().unwrap()
}

fn list<'a>(table: &'a Table, key: &str) -> &'a [Value] {
    table.get(key).map_or(&[], |v| v.as_array().unwrap())
}

/// Returns the generated entries whose files ship.
fn shipped(manifest: &Table) -> impl Iterator<Item = &Table> {
    let made = list(manifest, "made").iter().map(|made| made.as_table().unwrap());
    made.filter(|made| made.get("shipped").is_none_or(|shipped| shipped.as_bool().unwrap()))
}

/// Returns the scenarios that are run by default.
pub(crate) fn benchmark() -> Vec<Scenario> {
    formats::open(&folder().join("bench.parquet")).unwrap().map(Result::unwrap).collect()
}

#[test]
fn the_manifest_names_the_hand_made_scenarios() {
    let mut expected = String::new();
    let mut files: Vec<PathBuf> =
        fs::read_dir(folder().join("mini")).unwrap().map(|e| e.unwrap().path()).collect();
    files.sort();
    for path in files.iter().filter(|p| p.extension().is_some_and(|e| e == "json")) {
        let (content, name) = (fs::read(path).unwrap(), path.file_name().unwrap().to_string_lossy());
        let (bytes, digest) = (content.len(), blake3::hash(&content).to_hex());
        let entry =
            format!("\n[[hand_made]]\nname = \"mini/{name}\"\nbytes = {bytes}\nblake3 = \"{digest}\"\n");
        expected.push_str(&entry);
    }
    let stands: Table = expected.parse().unwrap();
    let same = list(&manifest(), "hand_made") == list(&stands, "hand_made");
    assert!(same, "put this into scenarios/manifest.toml:\n{expected}");
}

#[test]
fn the_manifest_names_what_was_generated() {
    let manifest = manifest();
    for made in shipped(&manifest) {
        let generator = made["generator"].as_integer().unwrap();
        assert_eq!(generator, i64::from(VERSION), "make the files again: {}", made["command"]);
        for file in list(made, "files") {
            let content = fs::read(folder().join(file["name"].as_str().unwrap())).unwrap();
            assert_eq!(file["bytes"].as_integer(), Some(content.len() as i64), "{file}");
            assert_eq!(file["blake3"].as_str(), Some(blake3::hash(&content).to_hex().as_str()), "{file}");
        }
    }
    let named: BTreeSet<&str> =
        shipped(&manifest).flat_map(|m| list(m, "files")).map(|f| f["name"].as_str().unwrap()).collect();
    for entry in fs::read_dir(folder()).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        assert!(!name.ends_with(".parquet") || named.contains(name.as_str()), "{name} is in no manifest");
    }
}

#[test]
fn what_ships_is_at_most_15_mb() {
    let mut bytes = 0;
    for folder in [folder(), folder().join("mini")] {
        let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().metadata().unwrap());
        bytes += entries.filter(fs::Metadata::is_file).map(|m| m.len()).sum::<u64>();
    }
    assert!(bytes <= 15_000_000, "{bytes}");
}

#[test]
fn the_benchmark_has_categories_difficulties_and_map_types_as_it_must() {
    let scenarios = benchmark();
    assert!(scenarios.len() >= 150, "{}", scenarios.len());
    let (mut categories, mut sources) = (BTreeMap::new(), BTreeMap::<String, u64>::new());
    let (mut difficulties, mut speeds) = (BTreeMap::new(), Vec::new());
    let records = store::read(folder().join("bench.deviations.parquet")).unwrap();
    for (scenario, record) in scenarios.iter().zip(records) {
        let (deviation, record) = (scenario.deviation.as_ref().unwrap(), record.unwrap());
        *categories.entry(deviation.category.unwrap()).or_insert(0) += 1;
        *sources.entry(scenario.source.clone()).or_default() += 1;
        let digest = scenario.digest();
        assert_eq!((&record.scenario_id, &record.scenario_digest), (&scenario.id, &digest));
        let [chosen] = record.candidates.as_slice() else { panic!("{}: one candidate", scenario.id) };
        assert!(chosen.chosen && chosen.rejected_by.is_none() && chosen.certificate.is_some());
        assert_eq!(chosen.candidate.track[1..], deviation.track);
        assert_eq!(chosen.certificate, deviation.certificate);
        *difficulties.entry(chosen.difficulty().unwrap()).or_insert(0) += 1;
        speeds.push(chosen.offsets.mean_speed_difference);
    }
    assert_eq!(categories, in_proportion(scenarios.len() as u64, &PROPORTIONS));
    // Difficulties are in proportion, and at least a quarter of the AVs are slower than their logs, and a
    // quarter faster.
    assert_eq!(difficulties, in_proportion(scenarios.len() as u64, &DIFFICULTIES));
    for side in [1.0, -1.0] {
        assert!(4 * speeds.iter().filter(|v| side * **v > 0.0).count() >= speeds.len(), "{speeds:?}");
    }
    let types: BTreeSet<String> = MAP_TYPES.iter().map(|m| format!("generated/{}", m.id)).collect();
    assert_eq!(sources.keys().cloned().collect::<BTreeSet<_>>(), types);
    let most = (2 * scenarios.len() as u64).div_ceil(types.len() as u64);
    assert!(sources.values().all(|n| *n <= most), "{sources:?}");
}

/// The commands of the manifest reproduce the bytes.
#[test]
fn what_was_generated_can_be_generated_again() {
    for made in shipped(&manifest()) {
        let home = tempfile::tempdir().unwrap();
        let command = made["command"].as_str().unwrap().strip_prefix("reactsim ").unwrap();
        let output = program().args(words(command)).current_dir(&home).output().unwrap();
        assert!(output.status.success(), "{command}");
        for file in list(made, "files") {
            let name = file["name"].as_str().unwrap();
            let (again, ships) =
                (fs::read(home.path().join(name)).unwrap(), fs::read(folder().join(name)).unwrap());
            assert!(
                again == ships,
                "{name} is not what `reactsim {command}` writes: make it again, and raise generation::VERSION"
            );
        }
    }
}
