//! Variants of a baseline next to it in one run: `idm@calm`, `ntp-reactive@mine`.

use std::fs;
use std::path::Path;

use reactsim::evaluation::{Adjustments, PlannedSimulator, read_summary, weights_file};

use crate::program::{said, text};
use crate::shared;

fn with_parameters(parameters: &[(&str, &str)]) -> Adjustments {
    let parameter =
        |(id, value): &(&str, &str)| ((*id).to_owned(), "vehicle.headway".to_owned(), (*value).to_owned());
    Adjustments { parameters: parameters.iter().map(parameter).collect(), ..Adjustments::default() }
}

#[test]
fn parameters_belong_to_the_variant_they_name() {
    let ids = ["idm", "idm+qp", "idm@calm", "idm@calm+qp"].map(str::to_owned);
    let values = |asked: &[(&str, &str)]| {
        let all = PlannedSimulator::adjusted(&ids, &with_parameters(asked)).unwrap();
        all.into_iter().map(|s| s.parameters.get("vehicle.headway").cloned()).collect::<Vec<_>>()
    };
    let some = |value: &str| Some(value.to_owned());
    // What is asked of a simulator is asked of it with a stage too, unless that has a value of its own.
    assert_eq!(values(&[("idm", "1.25")]), [some("1.25"), some("1.25"), None, None]);
    assert_eq!(values(&[("idm+qp", "2.5")]), [None, some("2.5"), None, None]);
    assert_eq!(values(&[("idm", "1.25"), ("idm+qp", "2.5")]), [some("1.25"), some("2.5"), None, None]);
    assert_eq!(values(&[("idm@calm", "2.5")]), [None, None, some("2.5"), some("2.5")]);
    assert_eq!(values(&[("idm@calm+qp", "2.5")]), [None, None, None, some("2.5")]);
    let titles = PlannedSimulator::by_ids(&ids).unwrap().into_iter().map(|s| s.title);
    assert_eq!(titles.collect::<Vec<_>>(), ["IDM", "IDM + qp", "IDM (calm)", "IDM (calm) + qp"]);
}

#[test]
fn by_default_variants_follow_their_baselines() {
    let asked = with_parameters(&[("idm@calm", "2.5"), ("stop", "1.0")]);
    let asked = Adjustments { parameters: asked.parameters[..1].to_vec(), ..asked };
    let ids: Vec<String> =
        PlannedSimulator::adjusted(&[], &asked).unwrap().into_iter().map(|s| s.id).collect();
    let idm = ids.iter().position(|id| id == "idm").unwrap();
    assert_eq!(ids[idm + 1], "idm@calm");
    assert_eq!(ids.iter().filter(|id| id.contains('@')).count(), 1);
}

#[test]
fn old_and_new_weights_stand_in_one_table() {
    let home = tempfile::tempdir().unwrap();
    let (file, out) = (home.path().join("mine.safetensors"), home.path().join("run"));
    let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("weights/ntp-reactive.safetensors");
    // Other weights of the same network: a small change of the last tensor.
    let mut bytes = fs::read(&shipped).unwrap();
    let last = bytes.len() - 4;
    let value = f32::from_le_bytes(bytes[last..].try_into().unwrap()) + 0.01;
    bytes[last..].copy_from_slice(&value.to_le_bytes());
    fs::write(&file, bytes).unwrap();
    let same = format!("ntp-reactive@same={}", text(&shipped));
    let other = format!("ntp-reactive@mine={}", text(&file));
    let models = ["ntp-reactive", "ntp-reactive@same", "ntp-reactive@mine"];
    let (ids, weights) = (models.join(","), ["--model-weights", &same, "--model-weights", &other]);
    let arguments = ["run", "--limit", "2", "--models", &ids, "--out", text(&out)];
    let (table, _) = said(&[&arguments[..], &weights].concat(), 0);
    for title in ["| NTP-reactive ", "| NTP-reactive (same) ", "| NTP-reactive (mine) "] {
        assert!(table.contains(title), "{table}");
    }
    let summary = read_summary(&out).unwrap();
    let [old, same, _] = models.map(|id| &summary.simulators[id]);
    assert_eq!(old.metrics["ade"], same.metrics["ade"], "the same weights under another name");
    let weights =
        summary.provenance.run.simulators.iter().map(|s| s.weights.as_ref().unwrap().sha256.as_str());
    let weights: Vec<&str> = weights.collect();
    assert!(weights[0] == weights[1] && weights[0] != weights[2]);

    // Without a label, the name of the file distinguishes them in tables.
    let plain = format!("ntp-reactive={}", text(&file));
    let (table, _) = said(&["run", "--limit", "1", "--models", "ntp-reactive", "--model-weights", &plain], 0);
    assert!(table.contains("| NTP-reactive (mine) "), "{table}");
}

#[test]
fn copies_of_published_weights_that_differ_are_named() {
    let Some(published) = shared("data/weights/pufferdrive_v2.safetensors") else { return };
    let home = tempfile::tempdir().unwrap();
    let mut bytes = fs::read(published).unwrap();
    let title_of = |bytes: &[u8]| {
        let file = home.path().join("copy.safetensors");
        fs::write(&file, bytes).unwrap();
        let weights = vec![("pufferdrive".to_owned(), weights_file(&file).unwrap())];
        let adjustments = Adjustments { weights, ..Adjustments::default() };
        PlannedSimulator::adjusted(&["pufferdrive".to_owned()], &adjustments).unwrap().remove(0).title
    };
    assert_eq!(title_of(&bytes), "PufferDrive");
    *bytes.last_mut().unwrap() ^= 1;
    assert_eq!(title_of(&bytes), "PufferDrive (copy)");
}
