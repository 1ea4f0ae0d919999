//! The house: rooms import only from floors below (see the crate's documentation).

use std::fs;
use std::path::{Path, PathBuf};

/// The floors from the ground up. A room may use the rooms of lower floors, and itself.
const FLOORS: &[&[&str]] = &[
    &["geometry"],
    &["scene"],
    &["rollout", "training", "formats", "dynamics"],
    &["models", "metrics", "generation"],
    &["evaluation", "curation"],
    &["report"],
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

/// The rooms that a text names after `crate::` or `reactsim::`, inside braces too.
fn imports(text: &str) -> Vec<String> {
    let name = |s: &str| s.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect::<String>();
    let code: String =
        text.lines().filter(|l| !l.trim_start().starts_with("//")).map(|l| format!("{l}\n")).collect();
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
        for used in imports(&fs::read_to_string(path).unwrap()) {
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
