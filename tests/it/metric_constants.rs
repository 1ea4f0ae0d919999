//! The constants of the metrics in `docs/metrics.md`, compared with the code.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use reactsim_test_support::documents::ROOT;

/// Folders and files whose constants the page lists.
const SOURCES: [&str; 4] =
    ["crates/metrics/src", "crates/planning/src/metrics", "crates/planning/src/contact.rs", LIMITS];
const LIMITS: &str = "crates/scene/src/dynamics/limits.rs";
/// Constants that no value depends on, or that follow from others.
const OTHERS: [&str; 6] = [
    "likelihood::MAX_BINS",
    "limits::STANDSTILL_SPEED",
    "limits::PARKED_DISPLACEMENT",
    "metrics::LONGEST",
    "metrics::LONGEST_UNIT",
    "motion::CHUNK",
];

/// Adds the Rust files of a folder that are no tests. The metrics of the Sim Agents challenge have the
/// configurations of its code.
fn files(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_file() {
        found.push(path.to_owned());
        return;
    }
    for entry in fs::read_dir(path).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_str().unwrap();
        if !matches!(name, "tests" | "tests.rs" | "wosac") {
            files(&path, found);
        }
    }
}

/// Returns the numbers in a text, without those in names such as `f64`.
fn numbers(text: &str) -> Vec<f64> {
    let text = text.replace('_', "");
    let words = text.split(|c: char| !(c.is_alphanumeric() || matches!(c, '.' | '-')));
    words.filter_map(|word| word.trim_end_matches('.').parse().ok()).collect()
}

/// Returns the constants of the code by module and name.
fn constants() -> BTreeMap<String, Vec<f64>> {
    let mut paths = Vec::new();
    SOURCES.iter().for_each(|source| files(&Path::new(ROOT).join(source), &mut paths));
    let mut found = BTreeMap::new();
    for path in paths {
        let text = fs::read_to_string(&path).unwrap();
        let module = path.file_stem().unwrap().to_str().unwrap();
        let code = text.split("#[cfg(test)]").next().unwrap();
        for part in code.split("const ").skip(1) {
            let Some((name, rest)) = part.split_once(':') else { continue };
            let is_name = name.chars().all(|c| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_');
            let Some((kind, value)) = rest.split_once('=').filter(|_| is_name) else { continue };
            if !["f64", "usize", "SavitzkyGolay", "Bins"].iter().any(|number| kind.contains(number)) {
                continue;
            }
            let value = numbers(value.split_once(';').unwrap_or((value, "")).0);
            let name = format!("{module}::{name}");
            if !value.is_empty() && !OTHERS.contains(&name.as_str()) {
                found.entry(name).or_insert(value);
            }
        }
    }
    let options = reactsim::metrics::Options::default().named();
    let (name, value) = options.into_iter().find(|(name, _)| *name == "corner_rounding").unwrap();
    found.insert(name.to_owned(), numbers(&value));
    found
}

#[test]
fn the_page_lists_every_constant_of_the_metrics() {
    let page = fs::read_to_string(Path::new(ROOT).join("docs/metrics.md")).unwrap();
    let section = page.split_once("\n## Constants\n").unwrap().1.split("\n## ").next().unwrap();
    let rows = section.lines().filter_map(|line| line.strip_prefix("| `"));
    let listed: BTreeMap<String, Vec<f64>> = rows
        .map(|row| {
            let (name, rest) = row.split_once('`').unwrap();
            (name.to_owned(), numbers(rest.split('|').nth(1).unwrap()))
        })
        .collect();
    let code = constants();
    assert!(code.len() > 60, "{code:?}");
    for (name, value) in &code {
        assert_eq!(listed.get(name), Some(value), "`{name}` in docs/metrics.md");
    }
    let gone: Vec<&String> = listed.keys().filter(|name| !code.contains_key(*name)).collect();
    assert!(gone.is_empty(), "docs/metrics.md lists constants that the code does not have: {gone:?}");
}

#[test]
fn the_definitions_state_the_constants() {
    let page = fs::read_to_string(Path::new(ROOT).join("docs/metrics.md")).unwrap();
    let section = page.split_once("\n## Definitions\n").unwrap().1.split("\n## ").next().unwrap();
    let plain = section.replace('\u{2212}', "-").replace('°', " °");
    let stated = numbers(&plain);
    let code = constants();
    let defined = ["collision::", "ttc::", "direction::", "lane_tracking::", "limits::", "kinematics::"];
    let defined = defined.iter().chain(&["log_clinging::", "likelihood::", "corner_rounding"]);
    for prefix in defined {
        for (name, values) in code.iter().filter(|(name, _)| name.starts_with(prefix)) {
            for value in values {
                assert!(stated.contains(value), "`{name}` = {value} is not in the definitions");
            }
        }
    }
}
