//! Checkpoints: the state of a training.

use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::TrainingError;
use super::adamw::AdamW;
use super::parameters::Layout;
use super::tensors::{NamedTensor, NamedTensors};

/// Kind and format version in the metadata of checkpoints.
const KIND: &str = "reactsim-training-1";
/// Prefixes of the tensor names of parameters and of their first and second moments.
const PREFIXES: [&str; 3] = ["model.", "first.", "second."];

/// State that determines the rest of a training.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Checkpoint {
    pub(super) progress: Progress,
    pub(super) values: Vec<f32>,
    pub(super) adamw: AdamW,
}

/// Progress of a training. The position in the order of the data follows from the step.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct Progress {
    /// Number of steps taken.
    pub(super) step: u64,
    /// Updates of the optimiser: fewer than steps if batches were empty.
    pub(super) updates: u64,
    /// The best validation so far.
    pub(super) best: Option<Best>,
    /// Number of validations since then.
    pub(super) stale: u64,
    /// Wall time spent, in seconds; informative only.
    pub(super) seconds: f64,
}

/// The best validation and its step.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Best {
    /// Number of steps taken before the validation.
    pub step: u64,
    /// Value of what [`Settings::best_by`](super::Settings::best_by) names.
    pub value: f64,
}

/// Returns the tensors of a flat list, named by `prefix` and the path of the parameter.
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
    /// Converts the checkpoint to the content of a file, with the identity of its training.
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

    /// Reads a checkpoint of the training with this identity. The error is a message.
    pub(super) fn of(mut file: NamedTensors, layout: &Layout, identity: &Value) -> Result<Self, String> {
        if file.about.get("kind").and_then(Value::as_str) != Some(KIND) {
            return Err(format!(
                "it is not a checkpoint of a training: its metadata lacks the kind `{KIND}`"
            ));
        }
        let differences = differences(file.about.get("training").unwrap_or(&Value::Null), identity);
        if !differences.is_empty() {
            return Err(format!("it is of another training: {}", differences.join("; ")));
        }
        let progress = file.about.remove("progress").unwrap_or_default();
        let progress: Progress =
            serde_json::from_value(progress).map_err(|e| format!("its progress cannot be read: {e}"))?;
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
            return Err(format!("the network does not have the tensor `{name}`"));
        }
        let [values, first, second] = lists.try_into().expect("there is one list for every prefix");
        let adamw = AdamW { first, second, updates: progress.updates };
        Ok(Self { progress, values, adamw })
    }
}

/// Returns the differences between the identities of two trainings: names with both values.
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

/// Refuses a folder that holds another training.
pub(super) fn refuse_other(path: &std::path::Path, old: &Value, new: &Value) -> Result<(), TrainingError> {
    let differences = differences(old, new);
    if differences.is_empty() {
        return Ok(());
    }
    Err(TrainingError::OtherTraining { path: path.to_owned(), differences: differences.join("; ") })
}
