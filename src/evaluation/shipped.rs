//! The benchmark that ships with the program.

use std::path::Path;

use super::{FileRecord, Source};
use crate::formats::native;

const NAME: &str = "bench.parquet";
/// Embedded, so that the program needs no files.
const CONTENT: &[u8] = include_bytes!("../../scenarios/bench.parquet");

impl Source {
    /// The shipped benchmark, or its first `most` scenarios.
    pub fn shipped(most: usize) -> Self {
        Self {
            file: FileRecord::of_content(NAME, "native", CONTENT),
            open: Box::new(move || Ok(Box::new(native::read_bytes(Path::new(NAME), CONTENT)?.take(most)))),
        }
    }
}
