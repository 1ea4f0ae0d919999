//! Partitions: parts of a work that processes do independently of each other, and that are joined later.

use std::fmt::{self, Display, Formatter};
use std::ops::Range;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

/// Largest number of partitions.
const MOST: usize = 1_000_000;

/// A partition, such as `2/8`: the second of eight consecutive parts of about the same size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Partition {
    number: usize,
    count: usize,
}

impl Partition {
    /// Returns its number, from 1.
    pub fn number(self) -> usize {
        self.number
    }

    /// Returns the number of partitions.
    pub fn count(self) -> usize {
        self.count
    }

    /// Returns which of `total` consecutive items the partition has.
    pub fn of(self, total: usize) -> Range<usize> {
        let bound = |number: usize| (number as u128 * total as u128 / self.count as u128) as usize;
        bound(self.number - 1)..bound(self.number)
    }

    /// Returns which records of each input the partition has. Whole inputs are divided if there are at least
    /// as many as partitions, and are then not read here. Otherwise records are divided: `records` returns
    /// the number of those of an input, and ranges within an input begin at multiples of `block`. Inputs
    /// without records are in all partitions.
    pub fn of_inputs(
        self,
        inputs: usize,
        block: usize,
        records: impl Fn(usize) -> usize,
    ) -> Vec<Range<usize>> {
        if inputs >= self.count {
            let own = self.of(inputs);
            return (0..inputs).map(|i| if own.contains(&i) { 0..usize::MAX } else { 0..0 }).collect();
        }
        let counts: Vec<usize> = (0..inputs).map(records).collect();
        let own = self.of(counts.iter().sum());
        let mut before = 0;
        let of_input = |&count: &usize| {
            let within = |at: usize| match at.saturating_sub(before) {
                at if at >= count => count,
                at => at - at % block.max(1),
            };
            let range = within(own.start)..within(own.end);
            before += count;
            if count == 0 { 0..usize::MAX } else { range }
        };
        counts.iter().map(of_input).collect()
    }
}

impl FromStr for Partition {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parts {
            Some((number, count)) if (1..=count).contains(&number) && count <= MOST => {
                Ok(Self { number, count })
            }
            _ => Err(format!("expected I/N with I from 1 to N, and N up to {MOST}, such as 2/8")),
        }
    }
}

impl Display for Partition {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.count)
    }
}

impl TryFrom<String> for Partition {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Partition> for String {
    fn from(partition: Partition) -> Self {
        partition.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn all(count: usize) -> impl Iterator<Item = Partition> {
        (1..=count).map(move |number| Partition { number, count })
    }

    #[test]
    fn every_record_is_in_one_partition_in_order() {
        for counts in [vec![13, 0, 6], vec![1], vec![7, 7, 7, 7], vec![]] {
            for (n, block) in [(1, 1), (2, 3), (3, 1), (5, 4), (40, 2)] {
                let mut found = vec![Vec::new(); counts.len()];
                for partition in all(n) {
                    let ranges = partition.of_inputs(counts.len(), block, |i| counts[i]);
                    for (input, range) in ranges.into_iter().enumerate() {
                        let range = range.start..range.end.min(counts[input]);
                        assert!(range.is_empty() || range.start.is_multiple_of(block));
                        found[input].extend(range);
                    }
                }
                let expected: Vec<Vec<usize>> = counts.iter().map(|n| (0..*n).collect()).collect();
                assert_eq!(found, expected, "{n} partitions");
            }
        }
    }

    #[test]
    fn texts_are_read() {
        let partition: Partition = "2/8".parse().unwrap();
        assert_eq!((partition.to_string().as_str(), partition.of(17)), ("2/8", 2..4));
        for wrong in ["0/8", "9/8", "1", "a/b", "1/0", "1/99999999999", "-1/2"] {
            assert!(wrong.parse::<Partition>().is_err(), "{wrong}");
        }
    }
}
