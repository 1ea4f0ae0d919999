//! Layers of the crate: modules import only from lower layers (see the crate's documentation).

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

/// Layers (floors) from the bottom up. A top-level module (room) may use those of lower layers, and itself.
const FLOORS: &[&[&str]] = &[
    &["files", "geometry", "work"],
    &["scene", "shards"],
    &["dynamics"],
    &["rollout", "training", "formats", "web"],
    &["models", "metrics", "generation", "external"],
    &["evaluation", "curation"],
    &["report"],
    &["benchmark"],
    &["cli"],
    &["main"],
];

/// The levels inside `models` from the ground up. A module may use modules of lower levels, and itself.
/// The other folders are the baselines, which are one level above all of these.
const MODEL_LEVELS: &[&[&str]] = &[
    &["card", "nn"],
    &["error"],
    &["ranges", "weights"],
    &["parameters"],
    &["setup"],
    &["diffusion", "joint_plan", "perception"],
    &["learning", "qp"],
];

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

/// Collects the Rust files below a folder.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// Returns the top-level module of a file: the first part of its path below `src` or `models`.
fn room(path: &Path) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = path.strip_prefix(root).unwrap();
    let mut parts = path.iter().map(|p| p.to_string_lossy().trim_end_matches(".rs").to_owned());
    match parts.next().as_deref() {
        Some("models") => "models".into(),
        _ => parts.next().unwrap(),
    }
}

/// Returns the number of `super` from a file to the root of the crate: 1 for the main file of a top-level
/// module.
fn depth(path: &Path) -> usize {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = path.strip_prefix(root).unwrap();
    let below = path.strip_prefix("src").unwrap_or(path);
    below.iter().count() - usize::from(path.ends_with("mod.rs"))
}

/// Returns a text without its comment lines.
fn code(text: &str) -> String {
    text.lines().filter(|l| !l.trim_start().starts_with("//")).map(|l| format!("{l}\n")).collect()
}

/// Returns the paths that follow `depth` times `super::` in a text, or more in modules within it.
fn climbs(text: &str, depth: usize) -> Vec<String> {
    let code = code(text);
    let (mut found, mut rest) = (Vec::new(), code.as_str());
    while let Some(at) = rest.find("super::") {
        rest = &rest[at..];
        let mut climbed = 0;
        while let Some(next) = rest.strip_prefix("super::") {
            (rest, climbed) = (next, climbed + 1);
        }
        if climbed >= depth {
            found.push(rest.split(';').next().unwrap_or_default().to_owned());
        }
    }
    found
}

/// Returns the top-level modules that a text names through `super::`.
fn climbed_rooms(text: &str, depth: usize) -> Vec<String> {
    let items = climbs(text, depth);
    // As if written from the root; names that are not top-level modules do not count.
    items.iter().flat_map(|item| imports(&format!("crate::{item}"))).filter(|n| floor(n).is_some()).collect()
}

/// Returns the top-level modules that a text names after `crate::` or `reactsim::`, also inside braces.
fn imports(text: &str) -> Vec<String> {
    let code = code(text);
    ["crate::", "reactsim::"].iter().flat_map(|prefix| names_after(&code, prefix)).collect()
}

/// Returns the names that follow a prefix, also inside braces.
fn names_after(code: &str, prefix: &str) -> Vec<String> {
    let name = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let mut found = Vec::new();
    for (at, _) in code.match_indices(prefix) {
        if code[..at].ends_with(|c: char| c == '$' || c == '_' || c.is_alphanumeric()) {
            continue;
        }
        let rest = &code[at + prefix.len()..];
        match rest.strip_prefix('{') {
            None => found.push(name(rest)),
            Some(list) => {
                let mut depth = 0;
                let mut start = true;
                for (i, c) in list.char_indices() {
                    match c {
                        '}' if depth == 0 => break,
                        '{' => depth += 1,
                        '}' => depth -= 1,
                        ',' if depth == 0 => start = true,
                        c if start && !c.is_whitespace() => {
                            found.push(name(&list[i..]));
                            start = false;
                        }
                        _ => {}
                    }
                }
            }
        }
    }
    found
}

#[test]
fn rooms_import_only_from_floors_below() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    sources(&root.join("src"), &mut files);
    sources(&root.join("models"), &mut files);
    for path in &files {
        let own = room(path);
        if own == "lib" {
            continue;
        }
        let Some(own_floor) = floor(&own) else {
            wrong.push(format!("{}: room `{own}` stands on no floor", path.display()));
            continue;
        };
        let text = fs::read_to_string(path).unwrap();
        for used in imports(&text).into_iter().chain(climbed_rooms(&text, depth(path))) {
            let below = floor(&used).is_some_and(|f| f < own_floor);
            // Items at the root of the crate belong to no module; there are none but the modules themselves.
            if used != own && !below {
                wrong.push(format!("{}: `{own}` uses `{used}`", path.display()));
            }
        }
    }
    assert!(files.len() > 20, "only {} files found", files.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn imports_are_found_in_braces_too() {
    let text = "use crate::{scene::{A, B}, cli};\n// crate::report\nlet x = reactsim::metrics::Y;";
    assert_eq!(imports(text), ["scene", "cli", "metrics"]);
}

#[test]
fn climbing_over_the_root_is_found() {
    let here = |path: &str| depth(&Path::new(env!("CARGO_MANIFEST_DIR")).join(path));
    assert_eq!(here("src/metrics/mod.rs"), 1);
    assert_eq!(here("src/metrics/ade.rs"), 2);
    assert_eq!(here("models/idm/mod.rs"), 2);
    let text = "use super::super::cli::main;\nuse super::report;\n// super::super::evaluation";
    assert_eq!(climbed_rooms(text, 2), ["cli"]);
    assert_eq!(climbed_rooms("let a = super::super::super::{evaluation, x};", 2), ["evaluation"]);
}

/// Returns the level of a module of `models`; `None` for other names.
fn model_level(module: &str) -> Option<usize> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("models").join(module);
    let is_folder = || !module.is_empty() && folder.is_dir();
    let listed = MODEL_LEVELS.iter().position(|modules| modules.contains(&module));
    listed.or_else(|| is_folder().then_some(MODEL_LEVELS.len()))
}

/// Returns the modules of the items that `models/mod.rs` re-exports.
fn model_exports(text: &str) -> BTreeMap<String, String> {
    let lines = text.lines().filter_map(|line| line.strip_prefix("pub use ")?.split_once("::"));
    lines
        .flat_map(|(module, items)| {
            names_after(&format!("models::{items}"), "models::").into_iter().map(|i| (i, module.to_owned()))
        })
        .collect()
}

/// Returns the modules of `models` that a text uses; `models` is `depth` times `super::` above it.
fn model_imports(text: &str, depth: usize, exports: &BTreeMap<String, String>) -> Vec<String> {
    let climbed =
        climbs(text, depth).into_iter().flat_map(|i| names_after(&format!("models::{i}"), "models::"));
    let names = names_after(&code(text), "models::").into_iter().chain(climbed);
    // Items of `models/mod.rs` itself, the list of baselines and their type, have no level.
    names.map(|n| exports.get(&n).cloned().unwrap_or(n)).filter(|n| model_level(n).is_some()).collect()
}

#[test]
fn models_import_only_from_levels_below() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("models");
    let exports = model_exports(&fs::read_to_string(root.join("mod.rs")).unwrap());
    let (mut files, mut wrong) = (Vec::new(), Vec::new());
    sources(&root, &mut files);
    for path in files.iter().filter(|path| **path != root.join("mod.rs")) {
        let first = path.strip_prefix(&root).unwrap().iter().next().unwrap().to_string_lossy().into_owned();
        let own = first.trim_end_matches(".rs");
        let Some(level) = model_level(own) else {
            wrong.push(format!("{}: module `{own}` has no level", path.display()));
            continue;
        };
        let text = fs::read_to_string(path).unwrap();
        for used in model_imports(&text, depth(path) - 1, &exports) {
            if used != own && model_level(&used) >= Some(level) {
                wrong.push(format!("{}: `{own}` uses `{used}`", path.display()));
            }
        }
    }
    assert!(files.len() > 100, "only {} files found", files.len());
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn imports_of_models_are_found_through_exports_and_braces() {
    let exports = model_exports("mod card;\npub use card::{Card, CardError};\npub use error::ModelError;");
    let found = |text: &str, depth: usize| model_imports(text, depth, &exports);
    assert_eq!(found("use crate::models::{self, ModelError, find, qp::Stage};", 1), ["error", "qp"]);
    assert_eq!(found("use super::{Card, nn};\nuse super::super::idm;", 1), ["card", "nn", "idm"]);
    assert!(found("use super::card;\nuse self::models_of::ntp;", 2).is_empty());
}
