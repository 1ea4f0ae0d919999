//! What a generated file was made from: the entry of a manifest, with which the file can be made again and checked.

use std::fmt::Write as _;
use std::path::Path;

use serde::Serialize;

use crate::evaluation::FileRecord;
use crate::generation::{GenerationSettings, VERSION};

/// A manifest with one entry.
#[derive(Serialize)]
pub(super) struct Manifest {
    made: [Made; 1],
}

/// One call of the program.
#[derive(Serialize)]
struct Made {
    command: String,
    /// [`VERSION`] of what made it.
    generator: u32,
    preset: &'static str,
    count: u32,
    seed: u64,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    maps: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    density: Option<f64>,
    files: Vec<Written>,
}

/// A file that it wrote.
#[derive(Serialize)]
struct Written {
    name: String,
    bytes: u64,
    blake3: String,
}

impl Manifest {
    /// The entry of these files, the first of which `--out` names.
    pub(super) fn new(settings: &GenerationSettings, count: u32, files: &[&Path]) -> anyhow::Result<Self> {
        let mut written = Vec::new();
        for path in files {
            let FileRecord { name, bytes, blake3, .. } = FileRecord::of(path, "")?;
            written.push(Written { name, bytes, blake3 });
        }
        let GenerationSettings { preset, seed, maps, density } = settings;
        let mut command =
            format!("reactsim generate --preset {} --count {count} --seed {seed}", preset.name());
        if !maps.is_empty() {
            write!(command, " --maps {}", maps.join(","))?;
        }
        if let Some(density) = density {
            write!(command, " --density {density}")?;
        }
        if let Some(first) = written.first() {
            write!(command, " --out {}", quoted(&first.name))?;
        }
        let made = Made {
            command,
            generator: VERSION,
            preset: preset.name(),
            count,
            seed: *seed,
            maps: maps.clone(),
            density: *density,
            files: written,
        };
        Ok(Self { made: [made] })
    }

    /// The entry as it stands in a manifest.
    pub(super) fn text(&self) -> anyhow::Result<String> {
        Ok(toml::to_string(self)?)
    }
}

/// A word as a shell reads it.
fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "._-+".contains(c);
    if word.chars().all(plain) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}
