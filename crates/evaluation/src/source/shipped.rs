//! The benchmark that ships with the program.

use std::path::Path;

use reactsim_formats::{FormatError, native};
use reactsim_scenarios::BENCH;

use crate::source::Source;
use crate::source::benchmarks::shipped_benchmark;
use crate::source::file_record::FileRecord;

const NAME: &str = "bench.parquet";

/// Returns the ids of the scenarios of the shipped benchmark.
///
/// # Errors
/// [`FormatError`] if it is damaged; a test rules it out.
pub fn shipped_ids() -> Result<Vec<String>, FormatError> {
    native::ids(Path::new(NAME), BENCH)
}

impl Source {
    /// The shipped benchmark, or its first `most` scenarios.
    pub fn shipped(most: usize) -> Self {
        Self {
            file: FileRecord::of_content(NAME, "native", BENCH),
            open: Box::new(move |first| {
                let records = native::read_bytes(Path::new(NAME), BENCH, first)?;
                Ok(Box::new(records.take(most.saturating_sub(first))))
            }),
            count: shipped_benchmark().map(|known| known.scenarios.min(most)),
        }
    }
}
