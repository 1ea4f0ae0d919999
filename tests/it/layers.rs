//! The house: rooms import only from floors below (see the crate's documentation).

use std::fs;
use std::path::{Path, PathBuf};

/// The floors from the ground up. A room may use the rooms of lower floors, and itself.
const FLOORS: &[&[&str]] = &[
    &["files", "geometry", "work"],
    &["scene"],
    &["dynamics"],
    &["rollout", "training", "formats", "web"],
    &["models", "metrics", "generation"],
    &["evaluation", "curation"],
    &["report"],
    &["benchmark"],
    &["cli"],
    &["main"],
];

fn floor(room: &str) -> Option<usize> {
    FLOORS.iter().position(|rooms| rooms.contains(&room))
}

/// Rust files below a folder.
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

/// The room of a file: the first part of its path below `src` or `models`.
fn room(path: &Path) -> String {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = path.strip_prefix(root).unwrap();
    let mut parts = path.iter().map(|p| p.to_string_lossy().trim_end_matches(".rs").to_owned());
    match parts.next().as_deref() {
        Some("models") => "models".into(),
        _ => parts.next().unwrap(),
    }
}

/// How many `super` lead from a file to the root of the crate: 1 for the main file of a room.
fn depth(path: &Path) -> usize {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = path.strip_prefix(root).unwrap();
    let below = path.strip_prefix("src").unwrap_or(path);
    below.iter().count() - usize::from(path.ends_with("mod.rs"))
}

/// A text without its lines of comment.
fn code(text: &str) -> String {
    text.lines().filter(|l| !l.trim_start().starts_with("//")).map(|l| format!("{l}\n")).collect()
}

/// The names that a text reaches from the root of the crate by climbing: `depth` times `super::`, or more in modules within it.
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
            // As if it were written from the root; what is no room is no concern.
            let item = rest.split(';').next().unwrap_or_default();
            found.extend(imports(&format!("crate::{item}")).into_iter().filter(|n| floor(n).is_some()));
        }
    }
    found
}

/// The rooms that a text names after `crate::` or `reactsim::`, inside braces too.
fn imports(text: &str) -> Vec<String> {
    let name = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let code = code(text);
    let mut found = Vec::new();
    for prefix in ["crate::", "reactsim::"] {
        for (at, _) in code.match_indices(prefix) {
            if code[..at].ends_with('$') {
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
        for used in imports(&text).into_iter().chain(climbs(&text, depth(path))) {
            let below = floor(&used).is_some_and(|f| f < own_floor);
            // Items at the root of the crate have no room; there are none but the rooms themselves.
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
    assert_eq!(climbs(text, 2), ["cli"]);
    assert_eq!(climbs("let a = super::super::super::{evaluation, x};", 2), ["evaluation"]);
}
