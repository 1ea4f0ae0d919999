//! Ranges of records, in which a run can be divided.

use serde::{Deserialize, Serialize};

use super::row::RecordPosition;

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
    /// Returns the index after the last record.
    pub fn end(&self) -> usize {
        self.first.saturating_add(self.count)
    }

    /// Returns whether a record is in the range.
    pub fn contains(&self, place: RecordPosition) -> bool {
        place.input == self.input && (self.first..self.end()).contains(&place.record)
    }
}
