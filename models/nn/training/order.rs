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
    /// Validation examples, in the order of the hashes of their origins; of several with one name the first.
    pub(super) held_out: Vec<usize>,
}

/// Holds examples out by a hash of their origins, independently of the rest of the data. If no hash is low
/// enough, but there are at least two different origins, that with the lowest hash is held out.
pub(super) fn split(source: &(impl Source + ?Sized), settings: &Settings) -> Split {
    let hash = |number: usize| leading_bits(&blake3::hash(source.origin(number).as_bytes()));
    let parts = source.parts();
    let (mut examples, mut names) = (BTreeMap::<u64, Vec<usize>>::new(), BTreeSet::new());
    for number in parts.iter().flat_map(|(numbers, _)| numbers) {
        if names.insert(source.id(*number)) {
            examples.entry(hash(*number)).or_default().push(*number);
        }
    }
    let low = |hash: u64| unit_interval(hash) <= settings.held_out;
    let mut held: BTreeSet<u64> = BTreeSet::new();
    if settings.held_out > 0.0 {
        held.extend(examples.keys().copied().filter(|h| low(*h)));
        if held.is_empty() && examples.len() > 1 {
            held.extend(examples.keys().next());
        }
    }
    let learned = parts.into_iter().map(|(mut numbers, times)| {
        numbers.retain(|n| !held.contains(&hash(*n)));
        (numbers, times)
    });
    let learned = learned.collect();
    let held_out =
        held.iter().flat_map(|hash| &examples[hash]).copied().take(settings.most_held_out).collect();
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

    #[test]
    fn examples_of_one_origin_are_held_out_together() {
        struct Windows(Vec<String>);
        impl Source for Windows {
            type Example = ();

            fn len(&self) -> usize {
                self.0.len()
            }

            fn id(&self, number: usize) -> &str {
                &self.0[number]
            }

            fn origin(&self, number: usize) -> &str {
                &self.0[number][..2]
            }

            fn read(&self, _: usize) -> Result<(), String> {
                Ok(())
            }

            fn digest(&self) -> String {
                String::new()
            }
        }
        let windows = Windows((0..120).map(|n| format!("{:02}@{}", n % 40, n / 40)).collect());
        let settings = Settings { held_out: 0.2, most_held_out: 100, ..Settings::default() };
        let split = split(&windows, &settings);
        let origins = |numbers: &[usize]| numbers.iter().map(|n| n % 40).collect::<BTreeSet<_>>();
        let learned = &split.learned[0].0;
        assert!(origins(learned).is_disjoint(&origins(&split.held_out)));
        assert_eq!(split.held_out.len(), 3 * origins(&split.held_out).len());
        assert_eq!(learned.len() + split.held_out.len(), 120);
        assert!((6..60).contains(&split.held_out.len()));
    }
}
