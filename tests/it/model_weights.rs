//! Weights and parameters from users: their use, their records, and every way in which they can be wrong.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Output;

use burn::tensor::Device;
use reactsim::models::ctg::network::Decoding;
use reactsim::models::nn::{Initializer, save};
use reactsim::models::pufferdrive::network::Network;
use reactsim::models::{MODELS, WeightsFile, find};

use crate::program::reactsim;

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

/// Returns the message of a run that is refused before its first scenario.
fn refused(arguments: &[&str]) -> String {
    let output = reactsim(&[&["run", "--limit", "1"], arguments].concat());
    assert_eq!(output.status.code(), Some(2), "{}", stderr(&output));
    assert!(output.stdout.is_empty());
    stderr(&output)
}

/// Returns untrained weights for a baseline whose weights do not ship; `None` if there is no rule for them.
pub(crate) fn untrained(id: &str) -> Option<WeightsFile> {
    let device = Device::flex();
    let mut init = Initializer::new(7, &device);
    let bytes = match id {
        "ntp-reactive" | "ntp-reactive-raw" => crate::ntp_reactive::untrained(),
        "regression" | "qp-regression" | "mtr" => crate::qp_regression::untrained(),
        "smart" | "smart-projected" => crate::smart_simulator::untrained(),
        "vbd" | "vbd-inpainting" => crate::vbd::untrained(),
        "ctg-cloning" => crate::ctg::untrained(Decoding::Cloning),
        "ctg-diffusion" | "ctg-guided" => crate::ctg::untrained(Decoding::Diffusion),
        "pufferdrive" => save(&Network::init(&mut init, &device), &BTreeMap::new()),
        _ => return None,
    };
    Some(WeightsFile::new("untrained.safetensors", bytes))
}

/// Replaces the first occurrence of a text in a file by another one of the same length.
pub(crate) fn replaced(file: &[u8], from: &str, to: &str) -> Vec<u8> {
    assert_eq!(from.len(), to.len());
    let mut file = file.to_vec();
    let at = file.windows(from.len()).position(|w| w == from.as_bytes()).unwrap();
    file[at..at + to.len()].copy_from_slice(to.as_bytes());
    file
}

/// Checks what `refusal` says of files that are cut, of another kind, or damaged. `good` is a file of a
/// network with two heads and width 16.
pub(crate) fn check_refusals(good: &[u8], refusal: impl Fn(&[u8]) -> String) {
    check_damaged(good, &refusal);
    let none = refusal(&replaced(good, "\\\"heads\\\":2", "\\\"heads\\\":0"));
    assert!(none.contains("heads = 0"), "{none}");
    let other = refusal(&replaced(good, "\\\"width\\\":16", "\\\"width\\\":32"));
    assert!(other.contains("expected ["), "{other}");
}

/// Checks what `refusal` says of files that are cut, of another kind, or hold a value that is not a number.
pub(crate) fn check_damaged(good: &[u8], refusal: impl Fn(&[u8]) -> String) {
    assert!(refusal(&good[..good.len() - 8]).contains("cut short"));
    assert!(refusal(b"").contains("cut short"));
    assert!(refusal(&crate::ntp_reactive::untrained()).contains("`reactive`"));
    let mut nan = good.to_vec();
    let end = nan.len();
    nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(refusal(&nan).contains("NaN"), "{}", refusal(&nan));
}

/// Writes a file of such weights and returns its bytes.
fn write_untrained(path: &Path) -> Vec<u8> {
    let bytes = untrained("pufferdrive").unwrap().bytes.into_owned();
    fs::write(path, &bytes).unwrap();
    bytes
}

fn given(path: &Path) -> String {
    format!("pufferdrive={}", path.display())
}

#[test]
fn weights_that_can_not_be_used_are_refused_before_the_first_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("some.safetensors");
    let models = ["--models", "pufferdrive"];

    let text = refused(&models);
    assert!(
        text.contains("`pufferdrive` needs weights") && text.contains("--model-weights pufferdrive=FILE"),
        "{text}"
    );
    let text = refused(&[&models[..], &["--model-weights", &given(&file)]].concat());
    assert!(text.contains("could not read") && text.contains("some.safetensors"), "{text}");
    for wrong in ["pufferdrive", "pufferdrive=", "=x"] {
        let text = refused(&["--model-weights", wrong]);
        assert!(text.contains("write ID=FILE"), "{text}");
    }

    let whole = write_untrained(&file);
    for (id, part) in [("stop", "`stop` has no weights"), ("nobody", "there is no simulator `nobody`")] {
        let text = refused(&["--models", id, "--model-weights", &format!("{id}={}", file.display())]);
        assert!(text.contains(part), "{text}");
    }
    let text = refused(&["--models", "stop", "--model-weights", &given(&file)]);
    assert!(text.contains("`pufferdrive`, which does not run"), "{text}");
    let text = refused(&["--model-weights", &given(&file), "--model-weights", &given(&file)]);
    assert!(text.contains("two values for `pufferdrive`"), "{text}");

    fs::write(&file, &whole[..whole.len() / 2]).unwrap();
    let text = refused(&["--model-weights", &given(&file)]);
    assert!(text.contains("some.safetensors of `pufferdrive`") && text.contains("cut short"), "{text}");

    fs::write(&file, "version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n").unwrap();
    let text = refused(&["--model-weights", &given(&file)]);
    assert!(text.contains("pointer of Git LFS") && text.contains("git lfs pull"), "{text}");

    let tensors = safetensors::SafeTensors::deserialize(&whole).unwrap().tensors();
    let count = tensors.len();
    let wrapped = tensors.into_iter().map(|(name, view)| (format!("module.{name}"), view));
    fs::write(&file, safetensors::serialize(wrapped, None).unwrap()).unwrap();
    let text = refused(&["--model-weights", &given(&file)]);
    assert!(text.contains("names of all tensors begin with `module.`"), "{text}");
    assert!(!text.contains("0 more") && count > 1, "{text}");

    // A file with the name of the published file must be that file.
    let known = folder.path().join("pufferdrive_v2.safetensors");
    fs::write(&known, &whole).unwrap();
    let text = refused(&["--model-weights", &given(&known)]);
    let found = WeightsFile::new("", whole).digest;
    assert!(text.contains(&found) && text.contains("d3b1b5ec0616a3b0a64b6059b41a931a"), "{text}");
}

#[test]
fn parameters_that_are_none_are_refused_by_name() {
    for (set, part) in [
        ("idm.vehicle.headwind=1", "no parameter `vehicle.headwind`; it has: "),
        ("idm.vehicle.headway=soon", "`soon` is not a valid `vehicle.headway`"),
        ("idm.vehicle.headway", "write ID.KEY=VALUE"),
        ("idm=1", "write ID.KEY=VALUE"),
        ("nobody.x=1", "there is no simulator `nobody`"),
        ("constant-velocity.x=1", "no parameter `x`; it has none"),
    ] {
        let text = refused(&["--set", set]);
        assert!(text.contains(part), "{text}");
    }
    let text = refused(&["--models", "stop", "--set", "idm.vehicle.headway=1"]);
    assert!(text.contains("`idm`, which does not run"), "{text}");
    let text = refused(&["--set", "stop.deceleration=1", "--set", "stop.deceleration=2"]);
    assert!(text.contains("--set has two values for `stop.deceleration`: give one"), "{text}");
}

#[test]
fn what_was_given_stands_in_the_results_and_counts_when_resuming() {
    let folder = tempfile::tempdir().unwrap();
    let (out, file) = (folder.path().join("run"), folder.path().join("some.safetensors"));
    let out = out.to_str().unwrap();
    let digest = WeightsFile::new("", write_untrained(&file)).digest;
    let weights = given(&file);
    let base =
        ["run", "--limit", "1", "--models", "stop,pufferdrive", "--model-weights", &weights, "--out", out];
    let output = reactsim(&[&base[..], &["--set", "stop.deceleration=2"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let table = stdout(&output);
    let line = format!("stop with deceleration=2.0, pufferdrive with some.safetensors ({}), ", &digest[..12]);
    // Underscores and similar characters are escaped in tables.
    assert!(table.replace('\\', "").contains(&line), "{line} is not in\n{table}");

    let text = fs::read_to_string(folder.path().join("run/provenance.json")).unwrap();
    let provenance: serde_json::Value = serde_json::from_str(&text).unwrap();
    assert_eq!(provenance["simulators"][0]["parameters"]["deceleration"], "2.0");
    assert_eq!(provenance["simulators"][0].get("weights"), None);
    assert_eq!(provenance["simulators"][1]["weights"]["sha256"], digest.as_str());
    assert_eq!(provenance["simulators"][1]["weights"]["name"], "some.safetensors");

    let resumed = reactsim(&[&base[..], &["--set", "stop.deceleration=2.0", "--resume"]].concat());
    assert_eq!(resumed.status.code(), Some(0), "{}", stderr(&resumed));
    let other = reactsim(&[&base[..], &["--resume"]].concat());
    assert!(
        stderr(&other).contains("parameters.deceleration` is \"2.0\" there and absent now"),
        "{}",
        stderr(&other)
    );
}

#[test]
fn lists_say_what_needs_weights() {
    let weights = stdout(&reactsim(&["list", "weights"]));
    let row = weights.lines().find(|l| l.starts_with("pufferdrive ")).unwrap();
    for part in ["pufferdrive_v2.safetensors", "2459480 bytes", "MIT", "to be given", "d3b1b5ec0616"] {
        assert!(row.contains(part), "{part} is not in {row}");
    }
    let models = stdout(&reactsim(&["list", "models"]));
    for model in MODELS {
        let row = models.lines().find(|l| l.starts_with(&format!("{} ", model.id))).unwrap();
        assert_eq!(row.contains("Needs --model-weights."), !model.is_complete(), "{row}");
    }
    assert!(!find("pufferdrive").unwrap().is_complete());
    assert!(find("pufferdrive").unwrap().simulator().is_err());
}
