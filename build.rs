//! Notes the commit that the program is built from, for the provenance of its numbers. Needs no network, and
//! no git either.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::{env, io};

/// Files and folders that decide the numbers of the program: a change in one of them after the commit is
/// marked with `+`.
const DECIDING: [&str; 8] =
    ["build.rs", "Cargo.toml", "Cargo.lock", "crates", "models", "scenarios", "src", "weights"];

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}

fn main() -> io::Result<()> {
    for path in DECIDING {
        println!("cargo:rerun-if-changed={path}");
    }
    let here = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").unwrap_or_default());
    note_commit(&here);
    Ok(())
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
        let status: Vec<&str> = ["status", "--porcelain", "--"].into_iter().chain(DECIDING).collect();
        let changed = git(&status).is_some_and(|files| !files.is_empty());
        println!("cargo:rustc-env=REACTSIM_COMMIT={commit}{}", if changed { "+" } else { "" });
    }
}
