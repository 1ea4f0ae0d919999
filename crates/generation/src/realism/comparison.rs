//! Comparison of two sets of scenarios.

use serde::Serialize;

use super::{Bins, Histogram, Measured, Quantity, divergence};

/// Comparison of two sets, quantity by quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Comparison {
    /// The set under test.
    pub generated: Side,
    /// The set it is compared with.
    pub reference: Side,
    /// One row per quantity, in the order of [`Quantity::ALL`].
    pub rows: Vec<Row>,
}

/// One of the compared sets.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Side {
    /// Name, as of a file or folder.
    pub name: String,
    /// Number of measured scenarios.
    pub scenarios: u64,
    /// Number of records that could not be read.
    pub failures: u64,
}

/// One quantity of both sets.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name in files.
    pub id: &'static str,
    /// Name for display.
    pub title: &'static str,
    /// Unit; empty for counts and shares.
    pub unit: &'static str,
    /// Definition of one value.
    pub of: &'static str,
    /// Whether sets are judged by this quantity.
    pub decides: bool,
    /// Bins of both histograms.
    pub bins: Bins,
    /// Values of the set under test.
    pub generated: Spread,
    /// Values of the set it is compared with.
    pub reference: Spread,
    /// Jensen-Shannon divergence of the histograms, base 2, from 0 (identical) to 1; `None` if a set has no
    /// values.
    pub divergence: Option<f64>,
    /// The same divergence between the two halves of the reference: what chance alone causes with this many
    /// scenarios.
    pub chance: Option<f64>,
}

/// Distribution of values. Without values there is neither a mean nor a quartile.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Spread {
    /// Number of values.
    pub n: u64,
    /// Mean.
    pub mean: Option<f64>,
    /// Lower quartile: a quarter of the values do not exceed it.
    pub lower_quartile: Option<f64>,
    /// Median.
    pub median: Option<f64>,
    /// Upper quartile: three quarters of the values do not exceed it.
    pub upper_quartile: Option<f64>,
    /// Number of values in each bin.
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
    /// Compares two named sets.
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
