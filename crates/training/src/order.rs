//! Order of the training examples, and the split into training and validation.

use std::collections::{BTreeMap, BTreeSet};

use super::hash::{leading_bits, unit_interval};
use super::stream::{shuffle, stream};
use super::{Settings, Source};

/// Endless order of the examples, a function of the seed and the parts only.
///
/// Each epoch takes the same number of examples from every part: the next ones in an endless sequence
/// of permutations, so that the counts of two examples of a part differ by at most one. The examples
/// taken from all parts are then shuffled.
pub(super) struct Order {
    seed: u64,
    parts: Vec<Part>,
    length: usize,
    /// Orders of the current epochs.
    known: BTreeMap<u64, Vec<usize>>,
}

struct Part {
    examples: Vec<usize>,
    /// Number of examples taken per epoch.
    taken: usize,
}

impl Order {
    pub(super) fn new(seed: u64, parts: &[(Vec<usize>, f64)]) -> Self {
        let part = |(examples, times): &(Vec<usize>, f64)| Part {
            taken: (examples.len() as f64 * times).round() as usize,
            examples: examples.clone(),
        };
        let parts: Vec<Part> = parts.iter().map(part).filter(|p| !p.examples.is_empty()).collect();
        let length = parts.iter().map(|p| p.taken).sum();
        Self { seed, parts, length, known: BTreeMap::new() }
    }

    /// Returns the number of examples per epoch.
    pub(super) fn length(&self) -> usize {
        self.length
    }

    /// Returns the examples at these places of the endless order. Calls with increasing places are
    /// efficient; others recompute epochs.
    pub(super) fn at(&mut self, places: std::ops::Range<u64>) -> Vec<usize> {
        let length = self.length as u64;
        let first = places.start / length;
        self.known.retain(|epoch, _| *epoch >= first);
        places
            .map(|place| {
                let (epoch, at) = (place / length, (place % length) as usize);
                if !self.known.contains_key(&epoch) {
                    let order = self.epoch(epoch);
                    self.known.insert(epoch, order);
                }
                self.known[&epoch][at]
            })
            .collect()
    }

    fn epoch(&self, epoch: u64) -> Vec<usize> {
        let mut list = Vec::with_capacity(self.length);
        for (number, part) in self.parts.iter().enumerate() {
            let size = part.examples.len() as u64;
            let mut place = epoch * part.taken as u64;
            let end = place + part.taken as u64;
            while place < end {
                let mut round = part.examples.clone();
                shuffle(&mut stream(self.seed, "round", place / size, &number.to_string()), &mut round);
                let stop = end.min((place / size + 1) * size);
                list.extend_from_slice(&round[(place % size) as usize..=((stop - 1) % size) as usize]);
                place = stop;
            }
        }
        shuffle(&mut stream(self.seed, "epoch", epoch, ""), &mut list);
        list
    }
}

/// Split of the examples into training and validation.
pub(super) struct Split {
    /// Training examples by part, with their repetitions per epoch.
    pub(super) learned: Vec<(Vec<usize>, f64)>,
    /// Validation examples, in the order of the hashes of their names.
    pub(super) held_out: Vec<usize>,
}

/// Holds examples out by a hash of their names, independently of the rest of the data. If no hash is
/// low enough, but there are at least two different names, the example with the lowest hash is held out.
pub(super) fn split(source: &impl Source, settings: &Settings) -> Split {
    let hash = |number: usize| leading_bits(&blake3::hash(source.id(number).as_bytes()));
    let parts = source.parts();
    let mut hashes = BTreeMap::new();
    for number in parts.iter().flat_map(|(numbers, _)| numbers) {
        hashes.entry(hash(*number)).or_insert(*number);
    }
    let low = |hash: u64| unit_interval(hash) <= settings.held_out;
    let mut held: BTreeSet<u64> = BTreeSet::new();
    if settings.held_out > 0.0 {
        held.extend(hashes.keys().copied().filter(|h| low(*h)));
        if held.is_empty() && hashes.len() > 1 {
            held.extend(hashes.keys().next());
        }
    }
    let learned = parts.into_iter().map(|(mut numbers, times)| {
        numbers.retain(|n| !held.contains(&hash(*n)));
        (numbers, times)
    });
    let learned = learned.collect();
    let held_out = held.iter().take(settings.most_held_out).map(|hash| hashes[hash]).collect();
    Split { learned, held_out }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_example_of_a_part_is_seen_as_often_as_asked() {
        let parts =
            [((0..10).collect(), 1.0), ((10..14).collect::<Vec<_>>(), 2.5), ((14..24).collect(), 0.3)];
        let mut order = Order::new(7, &parts);
        assert_eq!(order.length(), 23);
        let mut seen = [0; 24];
        for epoch in 0..10 {
            let numbers = order.at(epoch * 23..(epoch + 1) * 23);
            let mut here = [0; 24];
            numbers.iter().for_each(|n| here[*n] += 1);
            assert!(here[..10].iter().all(|n| *n == 1));
            assert!(here[10..14].iter().all(|n| (2..=3).contains(n)));
            numbers.iter().for_each(|n| seen[*n] += 1);
        }
        assert!(seen[10..14].iter().all(|n| *n == 25));
        assert!(seen[14..].iter().all(|n| *n == 3));
    }

    #[test]
    fn the_order_is_the_seeds_and_differs_from_epoch_to_epoch() {
        let parts = [((0..50).collect::<Vec<_>>(), 1.0)];
        let at = |seed, places| Order::new(seed, &parts).at(places);
        assert_eq!(at(1, 0..50), at(1, 0..50));
        assert_ne!(at(1, 0..50), at(2, 0..50));
        assert_ne!(at(1, 0..50), at(1, 50..100));
        let mut whole = Order::new(1, &parts);
        let pieces: Vec<usize> = (0..15).flat_map(|i| whole.at(i * 7..(i + 1) * 7)).collect();
        assert_eq!(pieces, at(1, 0..105));
    }
}
