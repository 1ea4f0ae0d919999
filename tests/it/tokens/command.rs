//! `reactsim train vocabulary`.

use std::fs;
use std::process::Command;

use reactsim::formats::native::Writer;
use reactsim::models::ntp::tokens::{MapVocabulary, Vocabulary};

use super::building::scenarios;
use crate::program::reactsim;
use reactsim::models::perception::Class;

#[test]
fn vocabularies_are_built_by_command() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    let data = path("data.parquet");
    let mut writer = Writer::create(std::path::Path::new(&data)).unwrap();
    scenarios().iter().take(4).for_each(|s| writer.write(s).unwrap());
    writer.finish().unwrap();
    let (out, map) = (path("v.safetensors"), path("map.safetensors"));
    let command = |out: &str| {
        let arguments = ["train", "vocabulary", &data, "--method", "k-disks", "--out", out, "--seed", "3"];
        [&arguments[..], &["--tokens", "100", "--fill", "--map-out", &map]]
            .concat()
            .iter()
            .map(|s| (*s).to_owned())
            .collect::<Vec<_>>()
    };
    let run = |arguments: &[String]| reactsim(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    let output = run(&command(&out));
    let said = String::from_utf8(output.stdout).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
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
    assert_eq!(run(&command(&again)).status.code(), Some(0));
    assert_eq!(fs::read(&again).unwrap(), bytes);
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 4, "no partial file is left");
}

#[test]
fn wrong_calls_are_refused_and_write_nothing() {
    let home = tempfile::tempdir().unwrap();
    let path = |name: &str| home.path().join(name).to_str().unwrap().to_owned();
    let (empty, out) = (path("empty"), path("v.safetensors"));
    fs::create_dir(&empty).unwrap();
    let error = |arguments: &[&str]| {
        let output = reactsim(&[&["train", "vocabulary"], arguments].concat());
        assert_eq!(output.status.code(), Some(2), "{arguments:?}");
        assert!(output.stdout.is_empty() && !std::path::Path::new(&out).exists());
        String::from_utf8(output.stderr).unwrap().replace(home.path().to_str().unwrap(), "HOME")
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
    assert_eq!(
        reactsim(&["train", "vocabulary", "--method", "kinematic", "--out", &out]).status.code(),
        Some(0)
    );
    assert_eq!(Vocabulary::read(&fs::read(&out).unwrap()).unwrap().provenance().method, "kinematic");
}

#[test]
fn a_full_disk_leaves_nothing_behind() {
    let home = tempfile::tempdir().unwrap();
    let out = home.path().join("v.safetensors");
    // Files of more than 4 KiB cannot be written, as if there were no room.
    let limited = "trap '' XFSZ; ulimit -f 4; exec \"$0\" train vocabulary --method kinematic --out \"$1\"";
    let program = assert_cmd::cargo::cargo_bin!("reactsim");
    let Ok(output) = Command::new("bash").args(["-c", limited]).arg(program).arg(&out).output() else {
        crate::skipped("no bash");
        return;
    };
    let error = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(2), "{error}");
    assert!(error.starts_with("error: could not write"), "{error}");
    assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
}
