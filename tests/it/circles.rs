//! No circular dependencies among the files of a module: a reader can start at a file that depends on no
//! other one and work upwards.
//!
//! The graph is read from the text: every path that begins with `crate`, `reactsim`, `self`, `super` or the
//! name of a child module. Re-exports are resolved to the file that defines the item, so that nothing
//! depends on a `mod.rs` that only re-exports. A module and the files below it count as one unit towards
//! each other: a `mod.rs` may use its children, and they may use what it defines.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};

/// A module by its path from the root of the crate.
type ModulePath = Vec<String>;

/// Files by module path.
type Graph = BTreeMap<ModulePath, BTreeSet<ModulePath>>;

/// A file and the names that it imports or re-exports, with their absolute paths.
struct Source {
    imports: BTreeMap<String, ModulePath>,
}

/// Circular dependencies that are allowed, each by one of its files, with the reason.
const ALLOWED: &[(&str, &str)] = &[];

fn root() -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
}

fn collect(folder: &Path, path: &mut ModulePath, files: &mut BTreeMap<ModulePath, PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let entry = entry.unwrap().path();
        let name = entry.file_stem().unwrap().to_string_lossy().into_owned();
        if entry.is_dir() {
            path.push(name);
            collect(&entry, path, files);
            path.pop();
        } else if entry.extension().is_some_and(|e| e == "rs") {
            let mut module = path.clone();
            if !["mod", "lib", "main"].contains(&name.as_str()) {
                module.push(name);
            }
            files.insert(module, entry);
        }
    }
}

/// Returns a text without comments, strings and test modules.
fn code(text: &str) -> String {
    let before_tests = text.split("#[cfg(test)]\nmod ").next().unwrap_or(text);
    let mut code = String::new();
    for line in before_tests.lines() {
        let line = line.split("//").next().unwrap_or(line);
        // Every second part is a string; an escaped quote shifts this by one line at most.
        for (i, part) in line.split('"').enumerate() {
            if i % 2 == 0 {
                code.push_str(part);
            }
        }
        code.push('\n');
    }
    code
}

fn is_name(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Collects the paths of a `use` tree: absolute path and local name.
fn expand(tree: &str, prefix: &[String], found: &mut Vec<(Vec<String>, String)>) {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let mut start = prefix.to_vec();
        start.extend(tree[..open].split("::").map(str::trim).filter(|s| !s.is_empty()).map(str::to_owned));
        let inner = tree[open + 1..].trim_end().strip_suffix('}').unwrap_or(&tree[open + 1..]);
        let (mut depth, mut from) = (0, 0);
        for (i, c) in inner.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    expand(&inner[from..i], &start, found);
                    from = i + 1;
                }
                _ => {}
            }
        }
        if !inner[from..].trim().is_empty() {
            expand(&inner[from..], &start, found);
        }
        return;
    }
    let (path, alias) = tree.split_once(" as ").map_or((tree, None), |(p, a)| (p.trim(), Some(a.trim())));
    let mut full = prefix.to_vec();
    full.extend(path.split("::").map(|s| s.trim().to_owned()).filter(|s| !s.is_empty() && s != "self"));
    if let Some(last) = full.last().cloned() {
        found.push((full, alias.map_or(last, str::to_owned)));
    }
}

/// Returns the path from the root of the crate of a path in a module; `None` for other crates and local
/// names.
fn absolute(path: &[String], module: &[String], children: &BTreeSet<String>) -> Option<ModulePath> {
    let first = path.first()?.as_str();
    if first == "crate" || first == "reactsim" {
        return Some(path[1..].to_vec());
    }
    let climbs = path.iter().take_while(|s| *s == "super").count();
    if climbs > 0 {
        let base = module.len().checked_sub(climbs)?;
        return Some([&module[..base], &path[climbs..]].concat());
    }
    if first == "self" {
        return Some([module, &path[1..]].concat());
    }
    children.contains(first).then(|| [module, path].concat())
}

/// Returns the statements `use …;` of a text, and the text without them.
fn uses(code: &str) -> (Vec<String>, String) {
    let (mut statements, mut rest) = (Vec::new(), String::new());
    let mut lines = code.lines();
    while let Some(line) = lines.next() {
        let trimmed = line.trim_start();
        let after = trimmed.strip_prefix("pub").map_or(trimmed, |s| match s.strip_prefix('(') {
            Some(inner) => inner.split_once(')').map_or(inner, |(_, after)| after),
            None => s,
        });
        match after.trim_start().strip_prefix("use ") {
            None => rest.push_str(line),
            Some(statement) => {
                let mut statement = statement.to_owned();
                while !statement.contains(';') {
                    let Some(next) = lines.next() else { break };
                    statement.push_str(next);
                }
                statements.push(statement.split(';').next().unwrap_or_default().to_owned());
            }
        }
        rest.push('\n');
    }
    (statements, rest)
}

/// Returns the paths with `::` in a text outside `use` statements.
fn inline_paths(code: &str) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    for word in code.split(|c: char| !is_name(c) && c != ':') {
        let word = word.trim_matches(':');
        if word.contains("::") {
            found.push(word.split("::").map(str::to_owned).collect());
        }
    }
    found
}

/// Returns the file that defines the item of a path, following re-exports.
fn resolve(path: &[String], sources: &BTreeMap<ModulePath, Source>, depth: usize) -> Option<ModulePath> {
    let length = (0..=path.len()).rev().find(|n| sources.contains_key(&path[..*n]))?;
    let (module, rest) = (path[..length].to_vec(), &path[length..]);
    if let Some(name) = rest.first().filter(|_| depth < 8)
        && let Some(target) = sources[&module].imports.get(name)
        && *target != path[..=length]
    {
        return resolve(&[target.as_slice(), &rest[1..]].concat(), sources, depth + 1);
    }
    Some(module)
}

fn graph() -> Graph {
    let mut files = BTreeMap::new();
    collect(&root().join("src"), &mut Vec::new(), &mut files);
    collect(&root().join("models"), &mut vec!["models".to_owned()], &mut files);
    let mut sources = BTreeMap::new();
    let mut named: BTreeMap<ModulePath, Vec<ModulePath>> = BTreeMap::new();
    for (module, path) in &files {
        let children: BTreeSet<String> = files
            .keys()
            .filter(|m| m.len() == module.len() + 1 && m.starts_with(module))
            .map(|m| m[module.len()].clone())
            .collect();
        let (statements, rest) = uses(&code(&fs::read_to_string(path).unwrap()));
        let mut imports = BTreeMap::new();
        let mut used = Vec::new();
        for statement in statements {
            let mut found = Vec::new();
            expand(&statement, &[], &mut found);
            for (path, name) in found {
                if let Some(target) = absolute(&path, module, &children) {
                    // A name that the rest of the file uses is a dependency; one that is only re-exported is
                    // not.
                    let is_used = rest.split(|c: char| !is_name(c)).any(|word| word == name);
                    if is_used || name == "*" {
                        used.push(target.clone());
                    }
                    imports.insert(name, target);
                }
            }
        }
        used.extend(inline_paths(&rest).iter().filter_map(|p| absolute(p, module, &children)));
        named.insert(module.clone(), used);
        sources.insert(module.clone(), Source { imports });
    }
    let mut graph = Graph::new();
    for (module, paths) in named {
        let targets = paths.iter().filter_map(|path| resolve(path, &sources, 0));
        let others = targets.filter(|t| !t.starts_with(&module) && !module.starts_with(t));
        graph.insert(module.clone(), others.collect());
    }
    graph
}

/// Returns every set of files that reach each other.
fn circles(graph: &Graph) -> Vec<Vec<ModulePath>> {
    let reach = |from: &ModulePath| {
        let (mut seen, mut open) = (BTreeSet::new(), vec![from.clone()]);
        while let Some(next) = open.pop() {
            for target in graph.get(&next).into_iter().flatten() {
                if seen.insert(target.clone()) {
                    open.push(target.clone());
                }
            }
        }
        seen
    };
    let reached: BTreeMap<&ModulePath, BTreeSet<ModulePath>> = graph.keys().map(|m| (m, reach(m))).collect();
    let mut found: Vec<Vec<ModulePath>> = Vec::new();
    for (module, targets) in &reached {
        if targets.contains(*module) && !found.iter().flatten().any(|m| m == *module) {
            let ring = targets.iter().filter(|t| reached.get(t).is_some_and(|r| r.contains(*module)));
            found.push(ring.cloned().collect());
        }
    }
    found
}

#[test]
fn files_do_not_depend_on_each_other_in_circles() {
    let graph = graph();
    assert!(graph.len() > 500 && graph.values().map(BTreeSet::len).sum::<usize>() > 1000);
    let mut wrong = Vec::new();
    for ring in circles(&graph) {
        let names: Vec<String> = ring.iter().map(|m| m.join("::")).collect();
        if names.iter().any(|n| ALLOWED.iter().any(|(allowed, _)| allowed == n)) {
            continue;
        }
        let edges = ring.iter().flat_map(|from| {
            let within = graph[from].iter().filter(|to| ring.contains(to));
            within.map(|to| format!("\n    {} -> {}", from.join("::"), to.join("::")))
        });
        wrong.push(format!("{}:{}", names.join(", "), edges.collect::<String>()));
    }
    assert!(wrong.is_empty(), "{} circles:\n{}", wrong.len(), wrong.join("\n"));
}
