//! Notes the commit that the program is built from, for the provenance of its numbers. Needs no network, and
//! no git either.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, io};

/// Files and folders that decide the numbers of the program, and what decides nothing in them, as patterns of
/// git: a change of what decides is marked with `+` if it comes after the commit.
const DECIDING: [&str; 11] = [
    "build.rs",
    "Cargo.toml",
    "Cargo.lock",
    "crates",
    "models",
    "scenarios",
    "src",
    "weights",
    ":(exclude,glob)**/tests/**",
    ":(exclude,glob)**/benches/**",
    ":(exclude,glob)**/*.md",
];

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() -> io::Result<()> {
    println!("cargo:rerun-if-changed=build.rs");
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    note_commit(&here);
    Ok(())
}

/// Runs a command of git for what decides the numbers.
fn git_of_deciding(arguments: &[&str]) -> Option<String> {
    git(&[arguments, &["--"], &DECIDING].concat())
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
    // Files, not their folders, so that an edit of a test or a document compiles nothing.
    for file in git_of_deciding(&["ls-files"]).unwrap_or_default().lines() {
        println!("cargo:rerun-if-changed={file}");
    }
    if let Some(commit) = git(&["rev-parse", "HEAD"]) {
        let changed = git_of_deciding(&["status", "--porcelain"]).is_some_and(|files| !files.is_empty());
        println!("cargo:rustc-env=REACTSIM_COMMIT={commit}{}", if changed { "+" } else { "" });
    }
}
