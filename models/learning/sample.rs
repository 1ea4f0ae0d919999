//! A sample of bounded size, without repetitions.

use std::collections::BTreeSet;

use rand::RngExt;
use reactsim::rollout::{Purpose, Stream, stream};

/// Names of things that were seen, per thing that is kept, before they are forgotten: a limit of memory.
const REMEMBERED: usize = 8;

/// A sample of at most so many things: every one that was seen is in it as likely as any other.
#[derive(Debug)]
pub(crate) struct Sample<T> {
    most: usize,
    pub(crate) kept: Vec<T>,
    /// How many different things there were, kept or not.
    pub(crate) seen: u64,
    names: BTreeSet<u64>,
    stream: Stream,
}

impl<T> Sample<T> {
    pub(crate) fn new(most: usize, seed: u64, name: &str) -> Self {
        Self {
            most: most.max(1),
            kept: Vec::new(),
            seen: 0,
            names: BTreeSet::new(),
            stream: stream(seed, name, 0, Purpose::Begin),
        }
    }

    /// Shows a thing to the sample. Things of the same values (to the step, or nearly) are one.
    pub(crate) fn add(&mut self, thing: T, values: impl Iterator<Item = f64>, step: f64) {
        if self.names.len() >= REMEMBERED * self.most {
            self.names.clear();
        }
        if !self.names.insert(name(values, step)) {
            return;
        }
        self.seen += 1;
        if self.kept.len() < self.most {
            self.kept.push(thing);
            return;
        }
        let at = self.stream.random_range(0..self.seen);
        if let Some(place) = usize::try_from(at).ok().and_then(|at| self.kept.get_mut(at)) {
            *place = thing;
        }
    }
}

/// A number for some values, the same where they are the same to the step.
fn name(values: impl Iterator<Item = f64>, step: f64) -> u64 {
    let mut bytes = Vec::with_capacity(128);
    for value in values {
        bytes.extend_from_slice(&((value / step).round() as i32).to_le_bytes());
    }
    blake3::hash(&bytes).as_bytes().iter().take(8).fold(0, |all, &byte| all << 8 | u64::from(byte))
}
