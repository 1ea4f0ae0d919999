//! What a metric is.

use super::{Case, Event, Score};

/// A metric of one scenario.
pub trait Metric: Sync {
    /// Id, title, unit and source.
    fn spec(&self) -> &'static MetricSpec;

    /// The value for one case, and what was counted; `None` where nothing could be judged (unknown is not zero).
    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score>;
}

/// What stands in tables and files about a metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetricSpec {
    /// Stable id, such as `aav-collision`.
    pub id: &'static str,
    /// Column title as in the paper's table.
    pub title: &'static str,
    /// What the value counts.
    pub unit: Unit,
    /// Whether less is better.
    pub lower_is_better: bool,
    /// Where it is defined.
    pub source: &'static str,
}

/// What a value counts, and so how it is averaged and printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A number per scenario; scenarios with nothing to count give 0.
    Count,
    /// A fraction in files, per cent in tables; scenarios with nothing to judge are left out.
    Rate,
    /// Metres.
    Metres,
    /// Metres per second squared.
    MetresPerSecondSquared,
    /// A number without unit.
    Plain,
}
