//! The interface of a metric.

use reactsim_scene::named_enum;

use super::{Case, Event, Score};

/// A metric of one scenario: of the benchmark ([`METRICS`](super::METRICS)) or your own
/// ([`Metrics`](super::Metrics)).
pub trait Metric: Send + Sync {
    /// Returns id, title, unit and source.
    fn spec(&self) -> &'static MetricSpec;

    /// Computes the score of one case and appends the counted events; `None` if nothing could be evaluated
    /// (unknown is not zero). A value of your own metric that is not finite fails the scenario.
    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score>;

    /// Returns whether every score other than 0 has at least one event that counts.
    fn has_events(&self) -> bool {
        false
    }
}

/// A metric of the benchmark.
pub(super) struct OfBenchmark {
    pub(super) spec: MetricSpec,
    pub(super) has_events: bool,
    pub(super) score: fn(&Case<'_>, &mut Vec<Event>) -> Option<Score>,
}

impl Metric for &'static OfBenchmark {
    fn spec(&self) -> &'static MetricSpec {
        &self.spec
    }

    fn score(&self, case: &Case<'_>, events: &mut Vec<Event>) -> Option<Score> {
        (self.score)(case, events)
    }

    fn has_events(&self) -> bool {
        self.has_events
    }
}

/// The description of a metric in tables and files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MetricSpec {
    /// Stable id, such as `aav-collision`.
    pub id: &'static str,
    /// Column title as in the paper's table.
    pub title: &'static str,
    /// Unit of the value.
    pub unit: Unit,
    /// Input of one value.
    pub scope: Scope,
    /// Whether lower values are better.
    pub lower_is_better: bool,
    /// Source of the definition.
    pub source: &'static str,
}

named_enum! {
    name;

    /// Input of one value of a metric.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Scope {
        /// One rollout; several rollouts of a scenario are averaged.
        Rollout = "rollout",
        /// All rollouts of a scenario together.
        Scenario = "scenario",
        /// The AV in one rollout, if it is judged: in runs in which a planner drives it.
        Av = "av",
    }
}

/// The unit of a metric, which decides how its values are averaged and printed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// A number per scenario; 0 for scenarios with nothing to count.
    Count,
    /// A fraction in files, a percentage in tables; scenarios with nothing to evaluate are left out.
    Rate,
    /// Metres.
    Metres,
    /// Metres per second squared.
    MetresPerSecondSquared,
    /// A number without unit.
    Plain,
    /// Another unit, such as `s`, which tables print.
    Other(&'static str),
}

impl Unit {
    /// Returns the name used in files; empty for numbers without a unit.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Count => "count",
            Self::Rate => "rate",
            Self::Metres => "m",
            Self::MetresPerSecondSquared => "m/s²",
            Self::Plain => "",
            Self::Other(name) => name,
        }
    }

    /// Returns the unit with this name.
    pub fn from_name(name: &'static str) -> Self {
        let known = [Self::Count, Self::Rate, Self::Metres, Self::MetresPerSecondSquared, Self::Plain];
        known.into_iter().find(|unit| unit.name() == name).unwrap_or(Self::Other(name))
    }
}
