//! Blocks of files that were read last. Formats are recognised by the same few blocks again and again.

use std::collections::VecDeque;
use std::sync::Arc;

/// Length of a block in bytes.
pub(super) const BLOCK: u64 = 1 << 16;
/// Maximum length in bytes of a block that is kept: that of the first block of sequential reading.
pub(super) const MAX_KEPT: u64 = 4 * BLOCK;
/// Number of blocks that are kept, 16 MiB at most.
const MAX_BLOCKS: usize = 64;

/// Blocks of files, by URL and offset; those that were added first are given up first.
#[derive(Default)]
pub(super) struct Blocks(VecDeque<(Arc<str>, u64, Arc<Vec<u8>>)>);

impl Blocks {
    /// Returns a block of a file that contains a position, with its offset.
    pub(super) fn find(&self, url: &str, position: u64) -> Option<(u64, Arc<Vec<u8>>)> {
        let contains = |start: u64, bytes: &[u8]| (start..start + bytes.len() as u64).contains(&position);
        let found = self.0.iter().rev().find(|(of, start, bytes)| contains(*start, bytes) && **of == *url);
        found.map(|(_, start, bytes)| (*start, Arc::clone(bytes)))
    }

    /// Keeps a block unless it is too long.
    pub(super) fn add(&mut self, url: Arc<str>, start: u64, bytes: Arc<Vec<u8>>) {
        if bytes.len() as u64 > MAX_KEPT {
            return;
        }
        if self.0.len() == MAX_BLOCKS {
            self.0.pop_front();
        }
        self.0.push_back((url, start, bytes));
    }
}
