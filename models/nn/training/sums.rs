//! Accumulated weighted means.

use std::collections::BTreeMap;

/// A sum and its total weight.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sum {
    total: f64,
    weight: f64,
}

/// Weighted means by name, such as the share of tokens that were predicted correctly.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums(BTreeMap<&'static str, Sum>);

impl Sums {
    /// Creates empty sums.
    pub fn new() -> Self {
        Self::default()
    }

    /// Adds a sum of values and the sum of their weights.
    pub fn add(&mut self, name: &'static str, total: f64, weight: f64) {
        let sum = self.0.entry(name).or_default();
        sum.total += total;
        sum.weight += weight;
    }

    /// Adds all of `other`.
    pub fn extend(&mut self, other: &Self) {
        for (name, sum) in &other.0 {
            self.add(name, sum.total, sum.weight);
        }
    }

    /// Returns the total weight under a name.
    pub fn weight(&self, name: &str) -> f64 {
        self.0.get(name).map_or(0.0, |sum| sum.weight)
    }

    /// Returns the mean under a name, if there is one and it is finite.
    pub fn mean(&self, name: &str) -> Option<f64> {
        self.0.get(name).map(|sum| sum.total / sum.weight).filter(|mean| mean.is_finite())
    }

    /// Returns the means by name, without those that are not finite.
    pub fn means(&self) -> BTreeMap<String, f64> {
        self.0.keys().filter_map(|name| Some(((*name).to_owned(), self.mean(name)?))).collect()
    }
}
