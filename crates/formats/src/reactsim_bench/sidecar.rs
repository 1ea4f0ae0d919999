//! Categories beside the files: in the names of folders, and in lists.

use std::collections::BTreeMap;
use std::path::Path;

use reactsim_scene::Deviation;
use serde_json::Value;

use super::BenchName;
use super::content::category_in;

/// Returns the category that the innermost folder above a file states.
pub fn category_of_path(path: &Path) -> Option<Deviation> {
    path.ancestors().find_map(|part| category_in(&part.file_name()?.to_string_lossy()))
}

/// Reads a list of names of files and their categories, by the stem of the file name. In JSON, a category is the
/// key or the value of names, or stands beside them; in other texts it is in the line of a name, or in a line of
/// its own above it.
pub fn sidecar(text: &str) -> BTreeMap<String, Deviation> {
    let mut found = BTreeMap::new();
    if let Ok(json) = serde_json::from_str::<Value>(text) {
        within(&json, None, &mut found);
        return found;
    }
    let mut above = None;
    for line in text.lines() {
        let is_table = line.contains([',', ';', '\t', '|']);
        let ends = |c: char| if is_table { ",;\t|:".contains(c) } else { c.is_whitespace() || c == ':' };
        let cells = line.split(ends).map(|cell| cell.trim_matches(|c: char| !c.is_alphanumeric()));
        let cells: Vec<&str> = cells.filter(|cell| !cell.is_empty()).collect();
        let stems: Vec<String> = cells.iter().filter_map(|cell| stem(cell)).collect();
        let stated = only(cells.iter().filter_map(|cell| category_in(cell)));
        if stems.is_empty() && !cells.is_empty() {
            above = stated.filter(|_| cells.len() == 1);
        }
        found.extend(stems.into_iter().filter_map(|stem| Some((stem, stated.or(above)?))));
    }
    found
}

/// Finds the names in a value with their categories; `above` is that of the value.
fn within(value: &Value, above: Option<Deviation>, found: &mut BTreeMap<String, Deviation>) {
    let here = stated(value).or(above);
    match value {
        Value::String(text) => found.extend(stem(text).zip(above)),
        Value::Array(items) => items.iter().for_each(|item| within(item, here, found)),
        Value::Object(entries) => {
            for (key, value) in entries {
                match stem(key) {
                    Some(stem) => found.extend(stated(value).or(here).map(|category| (stem, category))),
                    None => within(value, category_in(key).or(here), found),
                }
            }
        }
        _ => {}
    }
}

/// Returns the category that a text is, or that stands in a container, but not as the value of a name.
fn stated(value: &Value) -> Option<Deviation> {
    let category = |value: &Value| value.as_str().and_then(category_in);
    match value {
        Value::Array(items) => only(items.iter().filter_map(category)),
        Value::Object(entries) => {
            only(entries.iter().filter(|(key, _)| stem(key).is_none()).filter_map(|(_, v)| category(v)))
        }
        _ => category(value),
    }
}

/// Returns the value of which there is no other.
fn only(mut all: impl Iterator<Item = Deviation>) -> Option<Deviation> {
    let first = all.next()?;
    all.all(|other| other == first).then_some(first)
}

fn stem(text: &str) -> Option<String> {
    let path = Path::new(text);
    let stem = path.file_stem()?.to_string_lossy().into_owned();
    BenchName::of(path).is_ok().then_some(stem)
}
