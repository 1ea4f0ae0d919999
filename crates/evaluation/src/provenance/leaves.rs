//! Leaves of values as JSON, by which two values are compared.

use std::collections::BTreeMap;

use serde::Serialize;

/// Returns the leaves in which two values differ as JSON: path, and text in each.
pub fn differences<T: Serialize>(a: &T, b: &T) -> Vec<(String, String, String)> {
    let (mine, theirs) = (leaves(a), leaves(b));
    let absent = || "absent".to_owned();
    let value = |of: &BTreeMap<String, String>, key: &str| of.get(key).cloned().unwrap_or_else(absent);
    let only_theirs = theirs.keys().filter(|k| !mine.contains_key(*k));
    let differing = mine.keys().chain(only_theirs).filter(|k| mine.get(*k) != theirs.get(*k));
    differing.map(|k| (k.clone(), value(&mine, k), value(&theirs, k))).collect()
}

/// Returns every leaf of a value as JSON, by path.
pub(crate) fn leaves<T: Serialize>(value: &T) -> BTreeMap<String, String> {
    let mut out = BTreeMap::new();
    if let Ok(value) = serde_json::to_value(value) {
        flatten("", &value, &mut out);
    }
    out
}

/// Adds every leaf of a JSON value to `out`, by path.
fn flatten(path: &str, value: &serde_json::Value, out: &mut BTreeMap<String, String>) {
    let join = |key: &str| if path.is_empty() { key.to_owned() } else { format!("{path}.{key}") };
    match value {
        serde_json::Value::Object(map) => map.iter().for_each(|(k, v)| flatten(&join(k), v, out)),
        serde_json::Value::Array(list) => {
            list.iter().enumerate().for_each(|(i, v)| flatten(&format!("{path}[{i}]"), v, out));
        }
        leaf => {
            out.insert(path.to_owned(), leaf.to_string());
        }
    }
}
