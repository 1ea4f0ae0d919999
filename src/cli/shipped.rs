//! The benchmark that ships with the program.

use std::path::Path;

use crate::evaluation::{FileRecord, Source};
use crate::formats::native;

const NAME: &str = "bench.parquet";
/// Embedded, so that the program needs no files.
const BENCH: &[u8] = include_bytes!("../../scenarios/bench.parquet");

/// Returns the first `most` scenarios of the benchmark.
pub(super) fn benchmark(most: usize) -> Source {
    Source {
        file: FileRecord::of_content(NAME, "native", BENCH),
        open: Box::new(move || Ok(Box::new(native::read_bytes(Path::new(NAME), BENCH)?.take(most)))),
    }
}
