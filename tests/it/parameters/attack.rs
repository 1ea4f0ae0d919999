//! Every value for every parameter, each in a call of the program with a limit of time and memory.

use std::fs;

use reactsim::models::MODELS;

use super::values::{accepts, values};
use super::{ranges, setup};
use crate::attack::call::{Answer, call};

/// Returns the fault of an answer to a value, if it has one.
fn fault(answer: &Answer, key: &str, accepted: bool) -> Option<&'static str> {
    let Answer { code, error, .. } = answer;
    match code {
        _ if error.contains("panicked") => Some("panics"),
        None => Some("does not end"),
        Some(0) if accepted => None,
        Some(0) => Some("is accepted"),
        // A value within its range may still conflict with another parameter.
        Some(2) if accepted && !error.contains("expected at most") => Some("is refused"),
        Some(2) if !error.contains(key) => Some("is refused without its name"),
        Some(2) => None,
        Some(_) => Some("fails"),
    }
}

#[test]
#[cfg_attr(not(target_os = "linux"), ignore = "limits memory as Linux does")]
#[cfg_attr(target_os = "linux", ignore = "calls the program more than a thousand times")]
fn no_value_of_a_parameter_breaks_the_program() {
    let folder = tempfile::tempdir().unwrap();
    let mut faults = Vec::new();
    for model in MODELS {
        let setup = setup(model);
        let mut base: Vec<String> =
            ["run", "--limit", "1", "--jobs", "1", "--models", model.id].map(str::to_owned).to_vec();
        if !model.is_complete() {
            let path = folder.path().join(format!("{}.safetensors", model.id));
            fs::write(&path, &setup.weights.as_ref().unwrap().bytes).unwrap();
            base.extend(["--model-weights".to_owned(), format!("{}={}", model.id, path.display())]);
        }
        for (key, range) in ranges(&setup) {
            for value in values(&range.allowed, &format!("{} {key}", model.id)) {
                let set = format!("{}.{key}={value}", model.id);
                let answer = call(&[&base[..], &["--set".to_owned(), set.clone()]].concat(), folder.path());
                if let Some(fault) = fault(&answer, &key, accepts(&range.allowed, &value)) {
                    faults.push(format!("{set} {fault} ({:?}): {}", answer.code, answer.error.trim_end()));
                }
            }
        }
    }
    assert!(faults.is_empty(), "{} faults:\n{}", faults.len(), faults.join("\n"));
}
