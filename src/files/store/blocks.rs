//! Blocks of files that were read last. Formats are recognised by the same few blocks again and again.

use std::collections::VecDeque;
use std::sync::Arc;

/// Length of a block in bytes.
pub(super) const BLOCK: u64 = 1 << 16;
/// Number of blocks that are kept.
const MAX_BLOCKS: usize = 256;

/// Blocks of files, by URL and offset; those that were added first are given up first.
#[derive(Default)]
pub(super) struct Blocks(VecDeque<(Arc<str>, u64, Arc<Vec<u8>>)>);

impl Blocks {
    /// Returns the block of a file that begins at an offset.
    pub(super) fn find(&self, url: &str, start: u64) -> Option<Arc<Vec<u8>>> {
        let found = self.0.iter().rev().find(|(of, at, _)| *at == start && **of == *url);
        found.map(|(_, _, bytes)| Arc::clone(bytes))
    }

    /// Keeps a block.
    pub(super) fn add(&mut self, url: Arc<str>, start: u64, bytes: Arc<Vec<u8>>) {
        if self.0.len() == MAX_BLOCKS {
            self.0.pop_front();
        }
        self.0.push_back((url, start, bytes));
    }
}
