//! Two sets side by side.

use serde::Serialize;

use super::{Bins, Histogram, Measured, Quantity, divergence};

/// Two sets compared, quantity by quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The set in question.
    pub generated: Side,
    /// What it is held against.
    pub reference: Side,
    /// One per quantity, in their order.
    pub rows: Vec<Row>,
}

/// A set.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Side {
    /// Its name, as of a file or folder.
    pub name: String,
    /// Scenarios that were measured.
    pub scenarios: u64,
    /// Records that could not be read.
    pub failures: u64,
}

/// One quantity of both sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name in files.
    pub id: &'static str,
    /// Name for people.
    pub title: &'static str,
    /// Unit; empty for counts and shares.
    pub unit: &'static str,
    /// What one value is.
    pub of: &'static str,
    /// Whether the set is judged by it.
    pub decides: bool,
    /// Bins of both histograms.
    pub bins: Bins,
    /// The set in question.
    pub generated: Spread,
    /// What it is held against.
    pub reference: Spread,
    /// Jensen-Shannon divergence of the histograms, base 2, from 0 (the same) to 1; `None` where a set has no value.
    pub divergence: Option<f64>,
    /// The same between the two halves of the reference: what chance alone makes of as few scenarios.
    pub chance: Option<f64>,
}

/// How values are spread. Without values there is neither a mean nor a quartile.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Values.
    pub n: u64,
    /// Mean.
    pub mean: Option<f64>,
    /// Quartile that a quarter of the values do not exceed.
    pub lower_quartile: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// Quartile that three quarters of the values do not exceed.
    pub upper_quartile: Option<f64>,
    /// Values in each bin.
    pub histogram: Vec<u64>,
}

impl Spread {
    fn of(histogram: &Histogram) -> Self {
        Self {
            n: histogram.n(),
            mean: histogram.mean(),
            lower_quartile: histogram.quantile(0.25),
            median: histogram.quantile(0.5),
            upper_quartile: histogram.quantile(0.75),
            histogram: histogram.counts(),
        }
    }
}

impl Comparison {
    /// Compares two sets, given with their names.
    pub fn new(generated: (&str, &Measured), reference: (&str, &Measured)) -> Self {
        let side = |(name, set): (&str, &Measured)| Side {
            name: name.to_owned(),
            scenarios: set.halves.iter().map(|h| h.scenarios).sum(),
            failures: set.failures,
        };
        let (a, b) = (generated.1.whole(), reference.1.whole());
        let row = |quantity: Quantity| {
            let spec = quantity.spec();
            let (generated, reference_) = (Spread::of(a.of(quantity)), Spread::of(b.of(quantity)));
            let half = |k: usize| reference.1.halves[k].of(quantity).counts();
            Row {
                id: spec.id,
                title: spec.title,
                unit: spec.unit,
                of: spec.of,
                decides: quantity.decides(),
                bins: spec.bins,
                divergence: divergence(&generated.histogram, &reference_.histogram),
                chance: divergence(&half(0), &half(1)),
                generated,
                reference: reference_,
            }
        };
        Self {
            generated: side(generated),
            reference: side(reference),
            rows: Quantity::ALL.into_iter().map(row).collect(),
        }
    }
}
