//! Means that are still being summed up.

use std::collections::BTreeMap;

/// A sum and the weight it is divided by in the end.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Sum {
    total: f64,
    weight: f64,
}

/// Means by name, such as the share of tokens that were met.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sums(BTreeMap<&'static str, Sum>);

impl Sums {
    /// Nothing yet.
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

    /// The weight of what was summed up under a name.
    pub fn weight(&self, name: &str) -> f64 {
        self.0.get(name).map_or(0.0, |sum| sum.weight)
    }

    /// The mean of a name, if something was summed up under it and it is finite.
    pub fn mean(&self, name: &str) -> Option<f64> {
        self.0.get(name).map(|sum| sum.total / sum.weight).filter(|mean| mean.is_finite())
    }

    /// The means, by name; what nothing was summed up of, or is no finite number, is left out.
    pub fn means(&self) -> BTreeMap<String, f64> {
        self.0.keys().filter_map(|name| Some(((*name).to_owned(), self.mean(name)?))).collect()
    }
}
