//! Notes the commit that the program is built from, for the provenance of its numbers, and lists the scenarios that ship
//! with it. Needs no network, and no git either.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, fs, io};

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() -> io::Result<()> {
    for path in ["build.rs", "Cargo.toml", "Cargo.lock", "src", "models", "scenarios"] {
        println!("cargo:rerun-if-changed={path}");
    }
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    list_scenarios(&here)?;
    note_commit(&here);
    Ok(())
}

/// Writes the list of the files that are run when no scenarios are named, as Rust: names, formats and contents, so that the program works
/// from anywhere.
fn list_scenarios(here: &Path) -> io::Result<()> {
    let folder = here.join("scenarios");
    let bench = folder.join("bench.parquet");
    let (files, format) =
        if bench.exists() { (vec![bench], "native") } else { (texts(&folder.join("mini"))?, "json") };
    let mut list = String::from("&[\n");
    for path in files {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        writeln!(
            list,
            "    Shipped {{ name: {name:?}, format: {format:?}, content: include_bytes!({path:?}) }},"
        )
        .map_err(io::Error::other)?;
    }
    list.push(']');
    let out = PathBuf::from(env::var_os("OUT_DIR").unwrap_or_default());
    fs::write(out.join("shipped.rs"), list)
}

/// The JSON files of a folder, in the order of their names.
fn texts(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).into_iter().flatten() {
        let path = entry?.path();
        if path.extension().is_some_and(|e| e == "json") {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

fn note_commit(here: &Path) {
    // A package that lies unpacked inside some other checkout must not take that one's commit for its own.
    let top = git(&["rev-parse", "--show-toplevel"]).and_then(|top| Path::new(&top).canonicalize().ok());
    if top.is_none() || top != here.canonicalize().ok() {
        return;
    }
    for file in ["HEAD", "logs/HEAD"] {
        if let Some(path) = git(&["rev-parse", "--git-path", file])
            && Path::new(&path).exists()
        {
            println!("cargo:rerun-if-changed={path}");
        }
    }
    if let Some(commit) = git(&["rev-parse", "HEAD"]) {
        let changed = git(&["status", "--porcelain", "--", "src", "models", "Cargo.toml", "Cargo.lock"])
            .is_some_and(|files| !files.is_empty());
        println!("cargo:rustc-env=REACTSIM_COMMIT={commit}{}", if changed { "+" } else { "" });
    }
}
