//! Known benchmarks: sets of scenarios with a name, a version and a pinned digest.

use reactsim_scenarios::MANIFEST;
use serde::{Deserialize, Serialize};

use crate::source::file_record::FileRecord;

/// The benchmark of a run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BenchmarkRecord {
    /// Name, such as `reactsim-bench`.
    pub name: String,
    /// Version, such as `v1`.
    pub version: String,
    /// BLAKE3 digest of its file.
    pub blake3: String,
}

/// A benchmark that this program recognises by its digest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KnownBenchmark {
    /// Name, version and digest.
    pub record: BenchmarkRecord,
    /// Name of its file.
    pub file: String,
    /// Number of scenarios.
    pub scenarios: usize,
    /// Whether it is embedded in the program.
    pub shipped: bool,
}

impl BenchmarkRecord {
    /// Returns the known benchmark that a file contains.
    pub fn of(file: &FileRecord) -> Option<Self> {
        let known = known_benchmarks().into_iter().map(|known| known.record);
        known.into_iter().find(|record| record.blake3 == file.blake3 && file.is_plain())
    }

    /// Returns the known benchmark of this record; `None` if the program does not know it.
    pub fn known(&self) -> Option<KnownBenchmark> {
        known_benchmarks().into_iter().find(|known| known.record == *self)
    }
}

impl std::fmt::Display for BenchmarkRecord {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} {}", self.name, self.version)
    }
}

#[derive(Deserialize)]
struct Manifest {
    #[serde(default, rename = "made")]
    entries: Vec<ManifestEntry>,
}

/// An entry of the manifest; only benchmarks have a name and a version.
#[derive(Deserialize)]
struct ManifestEntry {
    benchmark: Option<String>,
    version: Option<String>,
    shipped: Option<bool>,
    #[serde(default)]
    count: usize,
    files: Vec<ManifestFile>,
}

#[derive(Deserialize)]
struct ManifestFile {
    name: String,
    blake3: String,
}

/// Returns all benchmarks of the manifest, in its order.
pub fn known_benchmarks() -> Vec<KnownBenchmark> {
    // A test ensures that the manifest is valid; with a damaged one the program knows no benchmarks.
    of_manifest(MANIFEST).unwrap_or_default()
}

/// Returns the benchmark that is embedded in the program.
pub fn shipped_benchmark() -> Option<KnownBenchmark> {
    known_benchmarks().into_iter().find(|known| known.shipped)
}

fn of_manifest(text: &str) -> Result<Vec<KnownBenchmark>, toml::de::Error> {
    let entries = toml::from_str::<Manifest>(text)?.entries;
    let known = entries.into_iter().filter_map(|entry| {
        let file = entry.files.into_iter().next()?;
        Some(KnownBenchmark {
            record: BenchmarkRecord { name: entry.benchmark?, version: entry.version?, blake3: file.blake3 },
            file: file.name,
            scenarios: entry.count,
            shipped: entry.shipped.unwrap_or(true),
        })
    });
    Ok(known.collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_manifest_has_one_shipped_benchmark() {
        let known = of_manifest(MANIFEST).unwrap();
        assert_eq!(known.iter().filter(|k| k.shipped).count(), 1);
        for (i, one) in known.iter().enumerate() {
            let BenchmarkRecord { name, version, blake3 } = &one.record;
            let same = |k: &&KnownBenchmark| k.record.name == *name && k.record.version == *version;
            assert!(!known[..i].iter().any(|k| same(&k) || k.record.blake3 == *blake3), "{}", one.record);
            assert!(one.scenarios > 0 && blake3.len() == 64);
        }
        let shipped = reactsim_scenarios::BENCH;
        let file = FileRecord::of_content("any name", "native", shipped);
        assert_eq!(BenchmarkRecord::of(&file), shipped_benchmark().map(|k| k.record));
    }

    #[test]
    fn benchmarks_need_not_ship() {
        let text = |shipped: &str| {
            format!(
                "[[made]]\nbenchmark = \"big\"\nversion = \"v2\"\n{shipped}command = \"x\"\ncount = 1500\n\
                 [[made.files]]\nname = \"big.parquet\"\nbytes = 1\nblake3 = \"ab\"\n"
            )
        };
        let [big] = of_manifest(&text("shipped = false\n")).unwrap().try_into().unwrap();
        assert_eq!((big.shipped, big.scenarios, big.record.to_string()), (false, 1500, "big v2".to_owned()));
        assert!(of_manifest(&text("")).unwrap()[0].shipped);
        assert_eq!(of_manifest("[[made]]\ncommand = \"x\"\nfiles = []\n").unwrap(), []);
    }
}
