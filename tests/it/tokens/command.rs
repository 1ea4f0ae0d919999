//! `reactsim train vocabulary`.

use std::fs;

use reactsim::models::ntp::tokens::{MapVocabulary, Vocabulary};
use reactsim::models::perception::Class;

use super::building::scenarios;
use crate::program::{refused, said, text};
use crate::small_scenarios::write;

#[test]
fn vocabularies_are_built_by_command() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&home.path().join(name)).to_owned();
    let data = path("data.parquet");
    write(data.as_ref(), scenarios().iter().take(4));
    let (out, map) = (path("v.safetensors"), path("map.safetensors"));
    let build = |out: &str| {
        let arguments = ["train", "vocabulary", &data, "--method", "k-disks", "--out", out, "--seed", "3"];
        said(&[&arguments[..], &["--tokens", "100", "--fill", "--map-out", &map]].concat(), 0).0
    };
    let said = build(&out);
    let manifest: toml::Table = said.parse().unwrap();
    let entry = &manifest["vocabulary"][0];
    let bytes = fs::read(&out).unwrap();
    assert_eq!(entry["id"].as_str(), Some("v"));
    assert_eq!(entry["blake3"].as_str().unwrap(), blake3::hash(&bytes).to_hex().as_str());
    assert_eq!(entry["scenarios"].as_integer(), Some(4));
    assert!(entry["tokens"][0]["error_mean"].as_float().unwrap() < 0.5, "{said}");
    let tokens = Vocabulary::read(&bytes).unwrap().tokens(Class::Vehicle);
    assert!((101..1124).contains(&tokens), "{tokens}");
    MapVocabulary::read(&fs::read(&map).unwrap()).unwrap();
    let again = path("again.safetensors");
    build(&again);
    assert_eq!(fs::read(&again).unwrap(), bytes);
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 4, "no partial file is left");
}

#[test]
fn wrong_calls_are_refused_and_write_nothing() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| text(&home.path().join(name)).to_owned();
    let (empty, out) = (path("empty"), path("v.safetensors"));
    fs::create_dir(&empty).unwrap();
    let error = |arguments: &[&str]| {
        let error = refused(&[&["train", "vocabulary"], arguments].concat());
        assert!(!fs::exists(&out).unwrap());
        error.replace(text(home.path()), "HOME")
    };
    let none = error(&[&empty, "--method", "trajtok", "--out", &out]);
    assert!(none.starts_with("error: HOME/empty"), "{none}");
    let none = error(&["--method", "k-disks", "--out", &out]);
    assert!(none.contains("SCENARIOS"), "{none}");
    let flag = error(&["--method", "kinematic", "--tokens", "9", "--out", &out]);
    assert_eq!(flag, "error: --tokens is for --method k-disks only\n");
    let map = error(&["--method", "kinematic", "--map-out", &path("m"), "--out", &out]);
    assert_eq!(map, "error: a map vocabulary (--map-out) is built from scenarios: give some\n");
    let folder = error(&["--method", "kinematic", "--out", &empty]);
    assert_eq!(folder, "error: could not write HOME/empty\n  cause: is a directory\n");
    let nowhere = error(&["--method", "kinematic", "--out", &path("no/such/v")]);
    assert!(nowhere.starts_with("error: could not write HOME/no/such/v"), "{nowhere}");
    said(&["train", "vocabulary", "--method", "kinematic", "--out", &out], 0);
    assert_eq!(Vocabulary::read(&fs::read(&out).unwrap()).unwrap().provenance().method, "kinematic");
}
