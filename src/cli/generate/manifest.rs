//! Manifest entry of generated files: the command and inputs that reproduce them, and their digests.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use serde::Serialize;

use crate::cli::output::quoted;
use crate::evaluation::FileRecord;
use crate::generation::{GenerationSettings, VERSION};
use crate::scene::{FUTURE, HISTORY, Length};

/// One call of the program.
#[derive(Serialize)]
struct ManifestEntry {
    command: String,
    /// [`VERSION`] of the generator.
    generator: u32,
    preset: &'static str,
    count: u32,
    seed: u64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    maps: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    density: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    history: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    future: Option<usize>,
    files: Vec<FileEntry>,
}

/// A file that the call wrote.
#[derive(Serialize)]
struct FileEntry {
    name: String,
    bytes: u64,
    blake3: String,
}

/// Returns the manifest of these files, of which the first is `--out`, as TOML.
pub(super) fn manifest(
    settings: &GenerationSettings,
    count: u32,
    files: &[PathBuf],
) -> anyhow::Result<String> {
    let mut written = Vec::new();
    for path in files {
        let FileRecord { name, bytes, blake3, .. } = FileRecord::of(path, "")?;
        written.push(FileEntry { name, bytes, blake3 });
    }
    let GenerationSettings { preset, seed, maps, density, length } = settings;
    let Length { history, future } = *length;
    let other = |frames: usize, usual: usize| (frames != usual).then_some(frames);
    let (history, future) = (other(history, HISTORY), other(future, FUTURE));
    let mut command = format!("reactsim generate --preset {} --count {count} --seed {seed}", preset.name());
    if !maps.is_empty() {
        write!(command, " --maps {}", maps.join(","))?;
    }
    if let Some(density) = density {
        write!(command, " --density {density}")?;
    }
    if let Some(history) = history {
        write!(command, " --history {history}")?;
    }
    if let Some(future) = future {
        write!(command, " --future {future}")?;
    }
    if let Some(first) = written.first() {
        write!(command, " --out {}", quoted(&first.name))?;
    }
    let entry = ManifestEntry {
        command,
        generator: VERSION,
        preset: preset.name(),
        count,
        seed: *seed,
        maps: maps.clone(),
        density: *density,
        history,
        future,
        files: written,
    };
    Ok(toml::to_string(&BTreeMap::from([("made", [entry])]))?)
}
