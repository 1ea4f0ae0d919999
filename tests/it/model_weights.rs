//! Weights and parameters from users: their use, their records, and every way in which they can be wrong.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use burn::module::Module;
use burn::tensor::Device;
use rand_chacha::rand_core::SeedableRng;
use reactsim::models::ctg::network::Decoding;
use reactsim::models::nn::{Initializer, save};
use reactsim::models::pufferdrive::network::Network;
use reactsim::models::{MODELS, WeightsFile, find};
use reactsim::scene::Scenario;
use reactsim::training::{Output, Stream, Task};

use crate::program::{self, json_of, said};
use crate::qp_regression::without_gradient;

/// Returns the message of a run that is refused before its first scenario.
fn refused(arguments: &[&str]) -> String {
    program::refused(&[&["run", "--limit", "1"], arguments].concat())
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
    check_cut(good, &refusal);
    assert!(refusal(&crate::ntp_reactive::untrained()).contains("`reactive`"));
}

/// Checks what `refusal` says of files that are cut, or hold a value that is not a number.
pub(crate) fn check_cut(good: &[u8], refusal: impl Fn(&[u8]) -> String) {
    assert!(refusal(&good[..good.len() - 8]).contains("cut short"));
    assert!(refusal(b"").contains("cut short"));
    let mut nan = good.to_vec();
    let end = nan.len();
    nan[end - 4..].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(refusal(&nan).contains("NaN"), "{}", refusal(&nan));
}

/// Returns the loss per item.
pub(crate) fn loss(output: &Output) -> f64 {
    f64::from(output.loss.clone().into_scalar::<f32>()) / output.items
}

/// Checks that a network of a task has a finite loss, with and without gradients. Returns the parameters that
/// have no gradient.
pub(crate) fn check_learning<T: Task<Example = Scenario>>(task: &T) -> Vec<String> {
    let model = task.init(3);
    let scenarios = crate::ntp_reactive::scenarios(3);
    let samples: Vec<_> = scenarios.iter().filter_map(|s| task.prepare(s, None)).collect();
    assert!(samples.len() >= 2);
    let output = task.loss(&model, &samples, Some(&mut Stream::seed_from_u64(0)));
    let learning = loss(&output);
    assert!(learning.is_finite() && output.items > 2.0, "{learning}");
    let still = without_gradient(&model, output.loss);
    // The same noise without autodiff gives the same loss.
    let plain = loss(&task.validate(&model.valid(), &samples));
    assert!((plain - learning).abs() < 1e-3 * learning.abs(), "{plain} {learning}");
    still
}

/// Writes a file of such weights and returns its bytes.
fn write_untrained(path: &Path) -> Vec<u8> {
    let bytes = untrained("pufferdrive").unwrap().bytes.into_owned();
    fs::write(path, &bytes).unwrap();
    bytes
}

#[test]
fn weights_that_can_not_be_used_are_refused_before_the_first_scenario() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("some.safetensors");
    let given = |path: &Path| format!("pufferdrive={}", path.display());
    let with = |content: Option<&[u8]>, arguments: &[&str], parts: &[&str]| {
        if let Some(content) = content {
            fs::write(&file, content).unwrap();
        }
        let text = refused(arguments);
        parts.iter().for_each(|part| assert!(text.contains(part), "{part}: {text}"));
        text
    };
    let of_file = given(&file);
    let asked = ["--model-weights", &of_file];
    let needs = ["`pufferdrive` needs weights", "`model-weights` pufferdrive=FILE"];
    with(None, &["--models", "pufferdrive"], &needs);
    with(None, &["--models", "pufferdrive", asked[0], asked[1]], &["could not read", "some.safetensors"]);
    for wrong in ["pufferdrive", "pufferdrive=", "=x"] {
        with(None, &["--model-weights", wrong], &["write ID=FILE"]);
    }

    let whole = write_untrained(&file);
    for (id, part) in [("stop", "`stop` has no weights"), ("nobody", "there is no simulator `nobody`")] {
        let weights = format!("{id}={}", file.display());
        with(None, &["--models", id, "--model-weights", &weights], &[part]);
    }
    with(None, &["--models", "stop", asked[0], asked[1]], &["`pufferdrive`, which does not run"]);

    with(Some(&whole[..whole.len() / 2]), &asked, &["some.safetensors of `pufferdrive`", "cut short"]);
    let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\nsize 9\n";
    with(Some(pointer), &asked, &["pointer of Git LFS", "git lfs pull"]);

    let tensors = safetensors::SafeTensors::deserialize(&whole).unwrap().tensors();
    let count = tensors.len();
    let wrapped = tensors.into_iter().map(|(name, view)| (format!("module.{name}"), view));
    let wrapped = safetensors::serialize(wrapped, None).unwrap();
    let text = with(Some(&wrapped), &asked, &["names of all tensors begin with `module.`"]);
    assert!(!text.contains("0 more") && count > 1, "{text}");

    // A file with the name of the published file must be that file.
    let known = folder.path().join("pufferdrive_v2.safetensors");
    fs::write(&known, &whole).unwrap();
    let found = WeightsFile::new("", whole).digest;
    with(None, &["--model-weights", &given(&known)], &[&found, "d3b1b5ec0616a3b0a64b6059b41a931a"]);
}

#[test]
fn parameters_that_are_none_are_refused_by_name() {
    for (set, part) in [
        ("idm.vehicle.headwind=1", "no parameter `vehicle.headwind`; it has: "),
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
    let weights = format!("pufferdrive={}", file.display());
    let models = ["--models", "stop,pufferdrive", "--model-weights", &weights];
    let run = |more: &[&str], code| {
        said(&[&["run", "--limit", "1", "--out", out], &models[..], more].concat(), code)
    };
    let (table, _) = run(&["--set", "stop.deceleration=2"], 0);
    let line = format!("stop with deceleration=2.0, pufferdrive with some.safetensors ({}), ", &digest[..12]);
    // Underscores and similar characters are escaped in tables.
    assert!(table.replace('\\', "").contains(&line), "{line} is not in\n{table}");

    let provenance = json_of(&folder.path().join("run/provenance.json"));
    assert_eq!(provenance["simulators"][0]["parameters"]["deceleration"], "2.0");
    assert_eq!(provenance["simulators"][0].get("weights"), None);
    assert_eq!(provenance["simulators"][1]["weights"]["sha256"], digest.as_str());
    assert_eq!(provenance["simulators"][1]["weights"]["name"], "some.safetensors");

    run(&["--set", "stop.deceleration=2.0", "--resume"], 0);
    let (_, other) = run(&["--resume"], 2);
    assert!(other.contains("parameters.deceleration` is \"2.0\" there and absent now"), "{other}");
}

#[test]
fn lists_say_what_needs_weights() {
    let (weights, _) = said(&["list", "weights"], 0);
    let row = weights.lines().find(|l| l.starts_with("pufferdrive ")).unwrap();
    for part in ["pufferdrive_v2.safetensors", "2459480 bytes", "MIT", "to be given", "d3b1b5ec0616"] {
        assert!(row.contains(part), "{part} is not in {row}");
    }
    let (models, _) = said(&["list", "models"], 0);
    for model in MODELS {
        let row = models.lines().find(|l| l.starts_with(&format!("{} ", model.id))).unwrap();
        assert_eq!(row.contains("Needs --model-weights."), !model.is_complete(), "{row}");
    }
    assert!(!find("pufferdrive").unwrap().is_complete());
    assert!(find("pufferdrive").unwrap().simulator().is_err());
}
