//! Reservoir sampling of distinct items.

use std::collections::BTreeSet;

use rand::RngExt;
use reactsim_rollout::{Purpose, Stream, stream};

use crate::training::leading_bits;

/// Keys of seen items to remember, as a multiple of the sample size. When there are more, all are
/// forgotten, which bounds memory.
const REMEMBERED_KEYS_PER_ITEM: usize = 8;

/// A sample of bounded size: every distinct item that was seen is in it with equal probability.
#[derive(Debug)]
pub struct Reservoir<T> {
    capacity: usize,
    /// The sample.
    pub kept: Vec<T>,
    /// Number of distinct items seen, kept or not.
    pub seen: u64,
    keys: BTreeSet<u64>,
    stream: Stream,
}

impl<T> Reservoir<T> {
    /// Creates an empty sample of at most `capacity` items, at least 1; the name and the seed determine the choices.
    pub fn new(capacity: usize, seed: u64, name: &str) -> Self {
        Self {
            capacity: capacity.max(1),
            kept: Vec::new(),
            seen: 0,
            keys: BTreeSet::new(),
            stream: stream(seed, name, 0, Purpose::Begin),
        }
    }

    /// Offers an item. Items whose values agree after rounding to multiples of `step` count as the
    /// same.
    pub fn add(&mut self, item: T, values: impl Iterator<Item = f64>, step: f64) {
        if self.keys.len() >= REMEMBERED_KEYS_PER_ITEM * self.capacity {
            self.keys.clear();
        }
        if !self.keys.insert(key_of(values, step)) {
            return;
        }
        self.seen += 1;
        if self.kept.len() < self.capacity {
            self.kept.push(item);
            return;
        }
        let at = self.stream.random_range(0..self.seen);
        if let Some(slot) = usize::try_from(at).ok().and_then(|at| self.kept.get_mut(at)) {
            *slot = item;
        }
    }
}

/// Returns a key for values that is the same for values that round to the same multiples of `step`.
fn key_of(values: impl Iterator<Item = f64>, step: f64) -> u64 {
    let mut bytes = Vec::with_capacity(128);
    for value in values {
        bytes.extend_from_slice(&((value / step).round() as i32).to_le_bytes());
    }
    leading_bits(&blake3::hash(&bytes))
}
