//! The scenarios that ship with the program.

use std::path::Path;

use crate::evaluation::{FileRecord, Source};
use crate::formats::{FormatError, PendingScenarios, decoded, native, parse_json};

/// A file of scenarios that is part of the program.
struct Shipped {
    name: &'static str,
    /// Id of its format: `native` or `json`.
    format: &'static str,
    content: &'static [u8],
}

/// What is run when no scenarios are named: `scenarios/bench.parquet`, and where that is missing when the program is built, the hand-made
/// scenes of `scenarios/mini` (see `build.rs`).
const FILES: &[Shipped] = include!(concat!(env!("OUT_DIR"), "/shipped.rs"));

/// One source per shipped file, with the first `most` scenarios of each.
pub(super) fn sources(most: usize) -> Vec<Source> {
    let source = |file: &'static Shipped| Source {
        file: FileRecord::of_content(file.name, file.format, file.content),
        open: Box::new(move || Ok(Box::new(read(file)?.take(most)))),
    };
    FILES.iter().map(source).collect()
}

fn read(file: &'static Shipped) -> Result<PendingScenarios, FormatError> {
    let name = Path::new(file.name);
    match file.format {
        "native" => native::read_bytes(name, file.content),
        _ => Ok(Box::new(std::iter::once(parse_json(name, file.content).map(decoded)))),
    }
}
