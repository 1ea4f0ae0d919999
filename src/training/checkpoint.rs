//! Where a training stands.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::TrainingError;
use super::adamw::AdamW;
use super::parameters::Layout;
use super::tensors::{NamedTensor, NamedTensors};

/// What checkpoints say they are.
const KIND: &str = "reactsim-training-1";
/// Before the names of parameters and of their moments.
const PREFIXES: [&str; 3] = ["model.", "first.", "second."];

/// All that the rest of a training depends on.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Checkpoint {
    pub(super) progress: Progress,
    pub(super) values: Vec<f32>,
    pub(super) adamw: AdamW,
}

/// How far a training is. The place in the order of the data follows from the step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Progress {
    /// Steps that were taken.
    pub(super) step: u64,
    /// Updates of the optimiser: fewer where batches were empty.
    pub(super) updates: u64,
    /// The lowest validation loss so far.
    pub(super) best: Option<Best>,
    /// Validations since.
    pub(super) stale: u64,
    /// Seconds that were spent; nothing depends on it.
    pub(super) seconds: f64,
}

/// The lowest validation loss, and when it was.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// Steps that were taken before.
    pub step: u64,
    /// Mean loss over the items that are held out.
    pub loss: f64,
}

/// Values by the names of the parameters, each after `prefix`.
pub(super) fn named<'a>(
    layout: &'a Layout,
    values: &'a [f32],
    prefix: &'a str,
) -> impl Iterator<Item = (String, NamedTensor)> + 'a {
    layout.parameters.iter().map(move |p| {
        let tensor = NamedTensor { shape: p.shape.clone(), values: values[p.range.clone()].to_vec() };
        (format!("{prefix}{}", p.path), tensor)
    })
}

impl Checkpoint {
    /// As a file of a training that is identified by this.
    pub(super) fn tensors(&self, layout: &Layout, identity: &Value) -> NamedTensors {
        let mut file = NamedTensors::default();
        for (prefix, values) in
            PREFIXES.into_iter().zip([&self.values, &self.adamw.first, &self.adamw.second])
        {
            file.tensors.extend(named(layout, values, prefix));
        }
        let progress = serde_json::to_value(&self.progress).expect("progress is numbers");
        file.about.insert("kind".to_owned(), KIND.into());
        file.about.insert("progress".to_owned(), progress);
        file.about.insert("training".to_owned(), identity.clone());
        file
    }

    /// From a file of a training that is identified by this. The refusal is in words.
    pub(super) fn of(mut file: NamedTensors, layout: &Layout, identity: &Value) -> Result<Self, String> {
        if file.about.get("kind").and_then(Value::as_str) != Some(KIND) {
            return Err(format!("it is no checkpoint of a training: its metadata name no kind `{KIND}`"));
        }
        let differences = differences(file.about.get("training").unwrap_or(&Value::Null), identity);
        if !differences.is_empty() {
            return Err(format!("it is of another training: {}", differences.join("; ")));
        }
        let progress = file.about.remove("progress").unwrap_or_default();
        let progress: Progress =
            serde_json::from_value(progress).map_err(|e| format!("its progress can not be read: {e}"))?;
        let mut lists = Vec::new();
        for prefix in PREFIXES {
            let mut list = Vec::with_capacity(layout.len);
            for parameter in &layout.parameters {
                let name = format!("{prefix}{}", parameter.path);
                let tensor = file.tensors.remove(&name);
                let tensor = tensor.ok_or_else(|| format!("the tensor `{name}` is missing"))?;
                if tensor.shape != parameter.shape {
                    let (found, expected) = (&tensor.shape, &parameter.shape);
                    return Err(format!("the tensor `{name}` is {found:?}, expected {expected:?}"));
                }
                list.extend(tensor.values);
            }
            lists.push(list);
        }
        if let Some((name, _)) = file.tensors.first_key_value() {
            return Err(format!("the network has no tensor `{name}`"));
        }
        let [values, first, second] = lists.try_into().expect("there is one list for every prefix");
        let adamw = AdamW { first, second, updates: progress.updates };
        Ok(Self { progress, values, adamw })
    }
}

/// What two trainings differ in: names with both values.
pub(super) fn differences(old: &Value, new: &Value) -> Vec<String> {
    let mut found = Vec::new();
    compare("", old, new, &mut found);
    found
}

fn compare(name: &str, old: &Value, new: &Value, found: &mut Vec<String>) {
    if let (Value::Object(a), Value::Object(b)) = (old, new) {
        let mut keys: Vec<&String> = a.keys().chain(b.keys()).collect();
        keys.sort();
        keys.dedup();
        for key in keys {
            let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
            let of = |map: &serde_json::Map<String, Value>| map.get(key).cloned().unwrap_or_default();
            compare(&name, &of(a), &of(b), found);
        }
    } else if old != new {
        found.push(format!("`{name}` is {old} there and {new} now"));
    }
}

/// The refusal of a folder whose training is another one.
pub(super) fn refuse_other(path: &std::path::Path, old: &Value, new: &Value) -> Result<(), TrainingError> {
    let differences = differences(old, new);
    if differences.is_empty() {
        return Ok(());
    }
    Err(TrainingError::OtherTraining { path: path.to_owned(), differences: differences.join("; ") })
}
