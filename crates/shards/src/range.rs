//! Ranges of records, in which work can be divided.

use serde::{Deserialize, Serialize};

/// Consecutive records of one input.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct RecordRange {
    /// Index of the input.
    pub input: usize,
    /// Index of the first record.
    pub first: usize,
    /// Number of records, at least 1.
    pub count: usize,
}

impl RecordRange {
    /// Divides inputs with these numbers of records into ranges of this many records, or fewer at the end of
    /// an input.
    pub fn divide(counts: &[usize], records: usize) -> impl Iterator<Item = Self> {
        let records = records.max(1);
        counts.iter().enumerate().flat_map(move |(input, &all)| {
            let of = move |first: usize| Self { input, first, count: records.min(all - first) };
            (0..all).step_by(records).map(of)
        })
    }

    /// Returns the index after the last record.
    pub fn end(&self) -> usize {
        self.first.saturating_add(self.count)
    }

    /// Returns whether a record of an input is in the range.
    pub fn contains(&self, input: usize, record: usize) -> bool {
        input == self.input && (self.first..self.end()).contains(&record)
    }
}
